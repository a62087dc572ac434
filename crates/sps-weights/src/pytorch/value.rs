//! What a pickle of tensors builds.

use std::collections::BTreeMap;

use safetensors::Dtype;

use crate::WeightsErrorKind;

/// The most axes of a tensor, and the longest name of one in bytes: a pickle can name a part again
/// in two bytes, and each time costs as much as the part is long.
const MOST_AXES: usize = 16;
const LONGEST_NAME: usize = 256;

/// The names that a pickle may use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Global {
    OrderedDict,
    Size,
    /// `_rebuild_tensor`, of PyTorch before 0.4, and `_rebuild_tensor_v2`.
    RebuildTensor,
    RebuildParameter,
    Storage(Dtype),
}

impl Global {
    /// The one of this name.
    pub(super) fn find(module: &str, name: &str) -> Result<Self, String> {
        Ok(match (module, name) {
            ("collections", "OrderedDict") => Self::OrderedDict,
            ("torch", "Size") => Self::Size,
            ("torch._utils", "_rebuild_tensor" | "_rebuild_tensor_v2") => Self::RebuildTensor,
            ("torch._utils", "_rebuild_parameter") => Self::RebuildParameter,
            _ => {
                let element = of_storage(name).filter(|_| module == "torch");
                let element = element.ok_or_else(|| format!("global {module}.{name}"))?;
                Self::Storage(element)
            }
        })
    }
}

/// The elements of a storage of this name.
fn of_storage(name: &str) -> Option<Dtype> {
    Some(match name {
        "HalfStorage" => Dtype::F16,
        "BFloat16Storage" => Dtype::BF16,
        "FloatStorage" => Dtype::F32,
        "DoubleStorage" => Dtype::F64,
        "LongStorage" => Dtype::I64,
        "IntStorage" => Dtype::I32,
        "ShortStorage" => Dtype::I16,
        "CharStorage" => Dtype::I8,
        "ByteStorage" => Dtype::U8,
        "BoolStorage" => Dtype::BOOL,
        _ => return None,
    })
}

/// A value on the pickle's stack; what has parts lies in the [`Heap`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Value {
    Mark,
    None,
    Bool(bool),
    Int(i128),
    Text(usize),
    Tuple(usize),
    List(usize),
    Dictionary(usize),
    Global(Global),
    Storage(usize),
    Tensor(usize),
}

/// Elements that a file holds outside of its pickle.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Storage {
    pub(super) key: String,
    pub(super) element: Dtype,
    pub(super) len: usize,
}

impl Storage {
    /// How many bytes it has.
    pub(super) fn bytes(&self) -> Option<usize> {
        self.len.checked_mul(self.element.bitsize() / 8)
    }
}

/// A view of a storage.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct View {
    pub(super) storage: usize,
    pub(super) offset: usize,
    pub(super) shape: Vec<usize>,
    pub(super) strides: Vec<usize>,
}

/// Everything with parts that the pickles of one file build. Parts are named by their number, so
/// nothing here is nested.
#[derive(Debug, Default)]
pub(super) struct Heap {
    texts: Vec<String>,
    /// Tuples and lists.
    sequences: Vec<Vec<Value>>,
    dictionaries: Vec<Vec<(usize, Value)>>,
    /// How many values lie in sequences and dictionaries.
    within: usize,
    storages: Vec<Storage>,
    /// The number of each storage.
    numbers: BTreeMap<Storage, usize>,
    views: Vec<View>,
}

impl Heap {
    /// How many values there are, those within others too.
    pub(super) fn values(&self) -> usize {
        let whole = self.texts.len() + self.storages.len() + self.views.len();
        whole + self.sequences.len() + self.dictionaries.len() + self.within
    }

    pub(super) fn text(&mut self, text: &str) -> Value {
        self.texts.push(text.to_owned());
        Value::Text(self.texts.len() - 1)
    }

    pub(super) fn as_text(&self, value: Value) -> Option<&str> {
        match value {
            Value::Text(index) => Some(&self.texts[index]),
            _ => None,
        }
    }

    pub(super) fn tuple(&mut self, items: Vec<Value>) -> Value {
        self.within += items.len();
        self.sequences.push(items);
        Value::Tuple(self.sequences.len() - 1)
    }

    pub(super) fn list(&mut self) -> Value {
        self.sequences.push(Vec::new());
        Value::List(self.sequences.len() - 1)
    }

    pub(super) fn extend(&mut self, list: usize, items: Vec<Value>) {
        self.within += items.len();
        self.sequences[list].extend(items);
    }

    pub(super) fn items(&self, sequence: usize) -> &[Value] {
        &self.sequences[sequence]
    }

    pub(super) fn dictionary(&mut self) -> Value {
        self.dictionaries.push(Vec::new());
        Value::Dictionary(self.dictionaries.len() - 1)
    }

    /// Puts an entry into a dictionary.
    pub(super) fn insert(
        &mut self,
        dictionary: usize,
        key: Value,
        value: Value,
    ) -> Result<(), String> {
        let Value::Text(key) = key else {
            return Err("a key that is no text".to_owned());
        };
        short(&self.texts[key])?;
        self.within += 1;
        self.dictionaries[dictionary].push((key, value));
        Ok(())
    }

    /// A dictionary's entries as they were put in.
    pub(super) fn entries(&self, dictionary: usize) -> impl Iterator<Item = (&str, Value)> {
        let entries = self.dictionaries[dictionary].iter();
        entries.map(|&(key, value)| (self.texts[key].as_str(), value))
    }

    pub(super) fn storages(&self) -> &[Storage] {
        &self.storages
    }

    pub(super) fn view(&self, index: usize) -> &View {
        &self.views[index]
    }

    /// What a persistent id means: `('storage', type, key, location, length, view)`.
    pub(super) fn storage(&mut self, id: Value) -> Result<Value, String> {
        let wrong = || Err("a persistent id that is no storage".to_owned());
        let Value::Tuple(id) = id else {
            return wrong();
        };
        let [tag, element, key, _, len, ref view @ ..] = *self.items(id) else {
            return wrong();
        };
        match view {
            [] | [Value::None] => {}
            [_] => return Err("a view of a storage".to_owned()),
            _ => return wrong(),
        }
        let named = (self.as_text(tag), self.as_text(key));
        let ((Some("storage"), Some(key)), Value::Global(Global::Storage(element))) =
            (named, element)
        else {
            return wrong();
        };
        let storage = Storage {
            key: short(key)?.to_owned(),
            element,
            len: natural(len)?,
        };
        let next = self.storages.len();
        let number = *self.numbers.entry(storage.clone()).or_insert(next);
        if number == next {
            self.storages.push(storage);
        }
        Ok(Value::Storage(number))
    }

    /// What a global returns for a tuple of arguments.
    pub(super) fn call(&mut self, global: Global, arguments: usize) -> Result<Value, String> {
        let items = self.items(arguments);
        match (global, items) {
            (Global::OrderedDict, []) => Ok(self.dictionary()),
            (Global::OrderedDict, &[Value::List(pairs)]) => self.ordered(pairs),
            (Global::Size, &[Value::Tuple(size)]) => Ok(Value::Tuple(size)),
            (Global::RebuildTensor, &[storage, offset, shape, strides, ..]) => {
                self.tensor([storage, offset, shape, strides])
            }
            (Global::RebuildParameter, &[Value::Tensor(tensor), ..]) => Ok(Value::Tensor(tensor)),
            _ => Err(format!("a call of {global:?} with other arguments")),
        }
    }

    /// A dictionary of a list of pairs, as Python 2 wrote it; the pairs leave the list.
    fn ordered(&mut self, pairs: usize) -> Result<Value, String> {
        let pairs = std::mem::take(&mut self.sequences[pairs]);
        self.within -= pairs.len();
        let all = self.dictionary();
        for pair in pairs {
            let items = match pair {
                Value::List(pair) | Value::Tuple(pair) => self.items(pair),
                _ => &[],
            };
            let (&[key, value], Value::Dictionary(all)) = (items, all) else {
                return Err("a dictionary of what are no pairs".to_owned());
            };
            self.insert(all, key, value)?;
        }
        Ok(all)
    }

    fn tensor(&mut self, [storage, offset, shape, strides]: [Value; 4]) -> Result<Value, String> {
        let (Value::Storage(storage), Value::Tuple(shape), Value::Tuple(strides)) =
            (storage, shape, strides)
        else {
            return Err("a tensor of what is no storage, shape and strides".to_owned());
        };
        let numbers = |tuple: usize| {
            let (items, axes) = (self.items(tuple).iter(), self.items(tuple).len());
            if axes > MOST_AXES {
                let many = format!("a tensor of {axes} axes, expected at most {MOST_AXES}");
                return Err(many);
            }
            items.copied().map(natural).collect()
        };
        let view = View {
            storage,
            offset: natural(offset)?,
            shape: numbers(shape)?,
            strides: numbers(strides)?,
        };
        view.check(&self.storages[storage])?;
        self.views.push(view);
        Ok(Value::Tensor(self.views.len() - 1))
    }
}

impl View {
    /// The number of elements.
    pub(super) fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Whether all of it lies in its storage, and no element of the storage is taken more often
    /// than there are elements.
    fn check(&self, storage: &Storage) -> Result<(), String> {
        // Without axes of no extent, so that the number of elements is no more than this.
        let mut extents = self.shape.iter();
        let count = extents.try_fold(1_usize, |count, &extent| count.checked_mul(extent.max(1)));
        let mut axes = self.shape.iter().zip(&self.strides);
        let last = axes.try_fold(self.offset, |last, (&extent, &stride)| {
            last.checked_add(extent.saturating_sub(1).checked_mul(stride)?)
        });
        let within = |count: usize| {
            let inside = last.is_some_and(|last| last < storage.len) && count <= storage.len;
            inside || self.shape.contains(&0)
        };
        if self.shape.len() == self.strides.len() && count.is_some_and(within) {
            return Ok(());
        }
        Err(format!(
            "a tensor of shape {:?} and strides {:?} from {} on in a storage of {}",
            self.shape, self.strides, self.offset, storage.len
        ))
    }

    /// The places in the storage of the elements, row-major.
    pub(super) fn places(&self) -> impl Iterator<Item = usize> {
        (0..self.len()).map(|mut index| {
            let axes = self.shape.iter().zip(&self.strides).rev();
            let mut place = self.offset;
            for (&extent, &stride) in axes {
                place += index % extent * stride;
                index /= extent;
            }
            place
        })
    }
}

/// A name, which is copied wherever it is used.
fn short(name: &str) -> Result<&str, String> {
    match name.len() {
        ..=LONGEST_NAME => Ok(name),
        len => Err(format!(
            "a name of {len} bytes, expected at most {LONGEST_NAME}"
        )),
    }
}

/// A count, an extent or an offset.
fn natural(value: Value) -> Result<usize, String> {
    let Value::Int(value) = value else {
        return Err("no number where a count must be".to_owned());
    };
    usize::try_from(value).map_err(|_| format!("{value} where a count must be"))
}

/// The tensors of a dictionary, in the order they were put in.
pub(super) fn tensors(heap: &Heap, value: Value) -> Result<Vec<(&str, &View)>, WeightsErrorKind> {
    let Value::Dictionary(dictionary) = value else {
        let message = "the pickle holds no dictionary of tensors";
        return Err(WeightsErrorKind::format(message));
    };
    let tensor = |(name, value)| match value {
        Value::Tensor(view) => Ok((name, heap.view(view))),
        _ => Err(format!("entry {name:?} of the pickle is no tensor")),
    };
    let tensors: Result<_, String> = heap.entries(dictionary).map(tensor).collect();
    tensors.map_err(WeightsErrorKind::Format)
}
