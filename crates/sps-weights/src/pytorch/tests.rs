//! Files that PyTorch wrote (`fixtures/pytorch/make_pytorch.py`), and files that nobody should
//! have written.

use std::collections::BTreeMap;

use proptest::prelude::*;

use super::value::{Heap, Value};
use super::{pickle, read};
use crate::{Storage, WeightsErrorKind};

fn fixture(name: &str) -> Vec<u8> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/pytorch");
    std::fs::read(folder.join(name)).unwrap()
}

/// What the script puts in.
fn expected() -> BTreeMap<&'static str, (Vec<usize>, Vec<f32>)> {
    let base: Vec<f32> = (0..24_u8).map(f32::from).collect();
    let transposed = (0..24).map(|i| base[i % 4 * 6 + i / 4]).collect();
    let whole = base.iter().map(|v| v / 8.0).collect();
    BTreeMap::from([
        ("whole", (vec![2, 3, 4], whole)),
        ("transposed", (vec![6, 4], transposed)),
        ("slice", (vec![6], base[5..11].to_vec())),
        ("half", (vec![2], vec![1.5, -2.25])),
        ("bfloat", (vec![2], vec![1.5, -2.25])),
        ("double", (vec![1], vec![0.1])),
        ("count", (vec![], vec![7.0])),
        ("parameter", (vec![2, 2], vec![1.0; 4])),
    ])
}

#[test]
fn both_formats_hold_what_pytorch_saved() {
    for file in ["zip.pth", "stream.pth"] {
        let tensors = crate::read(&fixture(file)).unwrap();
        let expected = expected();
        assert_eq!((tensors.len(), expected.len()), (8, 8));
        for (name, tensor) in &tensors {
            let (shape, values) = &expected[name.as_str()];
            assert_eq!((&tensor.shape, &tensor.values), (shape, values), "{name}");
        }
        let named = tensors.iter();
        let named = named.map(|(name, tensor)| (&name[..], tensor.clone()));
        let again = crate::write(named, Storage::F32, None).unwrap();
        assert_eq!(crate::read(&again).unwrap().len(), 8);
    }
    assert!(read(b"").is_none());
    assert!(read(b"\x80\x02}q\x00.").is_none());
}

#[test]
fn what_is_no_tensor_is_named() {
    let error = crate::read(&fixture("mapping.pth")).unwrap_err();
    let said = r#"entry "epoch" of the pickle is no tensor"#;
    assert_eq!(error.to_string(), said);
}

mod hard_cases {
    use super::*;

    fn run(pickle: &[u8]) -> Result<Value, WeightsErrorKind> {
        run_with(pickle, &mut Heap::default())
    }

    fn run_with(pickle: &[u8], heap: &mut Heap) -> Result<Value, WeightsErrorKind> {
        pickle::run(pickle, &mut 0, heap)
    }

    /// A pickle is refused: where, and in what words.
    fn refused(pickle: &[u8], at: usize, expected: &str) {
        match run(pickle) {
            Err(WeightsErrorKind::Pickle { offset, found }) => {
                assert_eq!((offset, found.as_str()), (at, expected));
            }
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn names_outside_of_the_list() {
        let call = b"\x80\x02cos\nsystem\nX\x02\0\0\0id\x85R.";
        refused(call, 2, "global os.system");
        refused(b"\x80\x02cbuiltins\neval\n.", 2, "global builtins.eval");
        refused(b"ctorch\nload\n.", 0, "global torch.load");
        let elsewhere = b"ctorch.storage\nFloatStorage\n.";
        refused(elsewhere, 0, "global torch.storage.FloatStorage");
        let stacked = b"\x80\x04\x8c\x05posix\x8c\x06system\x93.";
        refused(stacked, 17, "global posix.system");
        refused(b"cos", 0, "a line that does not end");
    }

    #[test]
    fn opcodes_outside_of_the_list() {
        for (pickle, found) in [
            (&b"(ios\nsystem\n."[..], "opcode INST (0x69)"),
            (b"(o.", "opcode OBJ (0x6f)"),
            (b"N\x81.", "opcode NEWOBJ (0x81)"),
            (b"N\x82\x01.", "opcode EXT (0x82)"),
            (b"N2.", "opcode DUP (0x32)"),
            (b"NPid\n.", "opcode PERSID (0x50)"),
            (b"N\xff.", "opcode unknown (0xff)"),
        ] {
            refused(pickle, 1, found);
        }
    }

    #[test]
    fn calls_of_what_may_not_be_called() {
        refused(b"N)R.", 2, "a call of what is no global");
        let dictionary = b"ccollections\nOrderedDict\nNR.";
        refused(dictionary, 26, "a call without a tuple of arguments");
        let tensor = b"ctorch._utils\n_rebuild_tensor_v2\n)R.";
        refused(tensor, 34, "a call of RebuildTensor with other arguments");
        let tensor = b"ctorch._utils\n_rebuild_tensor_v2\n(NNNNtR.";
        let expected = "a tensor of what is no storage, shape and strides";
        refused(tensor, 39, expected);
        let expected = "a call of Storage(F32) with other arguments";
        refused(b"ctorch\nFloatStorage\n)R.", 21, expected);
        refused(b"}N)b.", 3, "a state for what is no dictionary");
        refused(b"}q\0N}sb.", 5, "a key that is no text");
    }

    #[test]
    fn stacks_that_do_not_hold_what_is_asked_for() {
        refused(b".", 0, "a value where the stack holds none");
        refused(b"(.", 1, "a value where the stack holds none");
        refused(b"t.", 0, "the end of a part that has no beginning");
        refused(b"h\x05.", 0, "memo 5, which holds nothing");
        refused(b"}(Nu.", 3, "a key without a value");
        refused(b"N(u.", 2, "items for what is no dictionary");
        refused(b"\x80\x07.", 0, "protocol 7, expected 2 to 5");
        refused(b"N", 1, "1 bytes where 0 are left");
    }

    #[test]
    fn sizes_beyond_the_file() {
        let expected = "4294967295 bytes where 2 are left";
        refused(b"X\xff\xff\xff\xffa.", 0, expected);
        refused(b"\x8a\xff\x01.", 0, "an integer of 255 bytes");
        refused(b"\x8c\x01\xff.", 0, "a text that is not UTF-8");
        // A memo number of four billion takes one entry.
        assert!(run(b"Nr\xff\xff\xff\xff.").is_ok());
    }

    /// A tensor of a storage of six numbers.
    fn view(offset: &[u8], shape: &[u8], strides: &[u8]) -> Vec<u8> {
        let storage =
            b"(X\x07\0\0\0storagectorch\nFloatStorage\nX\x01\0\0\x000X\x03\0\0\0cpuK\x06tQ";
        let parts: [&[u8]; 7] = [
            b"ctorch._utils\n_rebuild_tensor_v2\n(",
            storage,
            offset,
            shape,
            strides,
            b"\x89}tR",
            b".",
        ];
        parts.concat()
    }

    #[test]
    fn views_beyond_their_storage() {
        assert!(run(&view(b"K\0", b"K\x02K\x03\x86", b"K\x03K\x01\x86")).is_ok());
        assert!(run(&view(b"K\x09", b"K\0K\x03\x86", b"K\x03K\x01\x86")).is_ok());
        let huge: &[u8] = b"J\xff\xff\xff\x7fJ\xff\xff\xff\x7fJ\xff\xff\xff\x7f\x87";
        let no_elements: &[u8] = b"(J\xff\xff\xff\x7fJ\xff\xff\xff\x7fJ\xff\xff\xff\x7fK\0t";
        let views: [(&[u8], &[u8], &[u8]); 8] = [
            (b"K\x01", b"K\x02K\x03\x86", b"K\x03K\x01\x86"),
            (b"K\0", b"K\x07\x85", b"K\0\x85"),
            (b"K\0", b"K\x02\x85", b"K\x01K\x01\x86"),
            (b"K\0", huge, b"K\0K\0K\0\x87"),
            (b"K\0", huge, huge),
            // No element, and a product of extents that no number holds.
            (b"K\0", no_elements, no_elements),
            (b"J\xff\xff\xff\xff", b"K\x02\x85", b"K\x01\x85"),
            (b"K\0", b"J\xff\xff\xff\xff\x85", b"K\x01\x85"),
        ];
        for (offset, shape, strides) in views {
            let error = run(&view(offset, shape, strides)).unwrap_err();
            assert!(matches!(error, WeightsErrorKind::Pickle { .. }));
        }
    }

    #[test]
    fn nesting_without_end() {
        let deep = [vec![b'('; 1 << 20], vec![b't'; 1 << 20], b".".to_vec()].concat();
        assert!(run(&deep).is_ok());
        let chain = [b"N".to_vec(), vec![0x85; 1 << 20], b".".to_vec()].concat();
        assert!(run(&chain).is_ok());
        // A dictionary and a list that hold themselves.
        for cycle in [&b"}q\0X\x01\0\0\0ah\0s."[..], b"]q\0h\0a."] {
            assert!(run(cycle).is_ok());
        }
        let long = b"\x80\x02".repeat(4 << 20);
        refused(&long, 4 << 20, "1 bytes where 0 are left");
    }

    #[test]
    fn values_without_number() {
        let most = "more than 2100000 values";
        refused(&vec![b'('; 4 << 20], 2_100_000, most);
        // A list is one value, and one more on the stack; so is a text, and a dictionary's entry.
        refused(&vec![b']'; 4 << 20], 1_050_000, most);
        refused(&b"\x8c\0".repeat(2 << 20), 2_100_000, most);
        let list = |at: u32| [&b"]r"[..], &at.to_le_bytes()].concat();
        let memo: Vec<u8> = (0..1 << 19).flat_map(list).collect();
        assert!(run(&[&memo[..], b"."].concat()).is_ok());
        refused(&[&memo[..], &vec![b'}'; 1 << 19]].concat(), 3_409_296, most);
    }

    /// Parts that a pickle names again in a few bytes: work must grow with its own bytes alone.
    #[test]
    fn parts_that_are_named_again() {
        let axes = |count: usize| [&b"("[..], &b"K\x01".repeat(count), b"t"].concat();
        assert!(run(&view(b"K\0", &axes(16), &axes(16))).is_ok());
        let error = run(&view(b"K\0", &axes(17), &axes(17))).unwrap_err();
        assert!(error.to_string().contains("a tensor of 17 axes"), "{error}");

        let name = |len: u32| [&b"}X"[..], &len.to_le_bytes(), &vec![b'a'; len as usize]].concat();
        assert!(run(&[&name(256)[..], b"Ns."].concat()).is_ok());
        let error = run(&[&name(257)[..], b"Ns."].concat()).unwrap_err();
        assert!(error.to_string().contains("a name of 257 bytes"), "{error}");

        // A list of pairs that two dictionaries are made of: it can be used up once.
        let pairs = b"]q\0X\x01\0\0\0aN\x86a";
        let dictionary = b"ccollections\nOrderedDict\nh\0\x85R";
        let heap = &mut Heap::default();
        let twice = [&pairs[..], dictionary, dictionary, b"."].concat();
        let Value::Dictionary(last) = run_with(&twice, heap).unwrap() else {
            panic!("no dictionary");
        };
        assert_eq!(heap.entries(last).count(), 0);
    }

    /// As many storages as a pickle has room for; compared with one another they take minutes.
    #[test]
    fn storages_without_number() {
        let mut pickle =
            b"(X\x07\0\0\0storageq\0ctorch\nFloatStorage\nq\x01X\x01\0\0\x000q\x02".to_vec();
        let count = 200_000_u32;
        for len in 0..count {
            pickle.extend(b"(h\0h\x01h\x02NJ");
            pickle.extend(len.to_le_bytes());
            pickle.extend(b"tQ");
        }
        pickle.extend(b"t.");
        let mut heap = Heap::default();
        assert!(run_with(&pickle, &mut heap).is_ok());
        assert_eq!(heap.storages().len(), count as usize);
    }

    #[test]
    fn tensors_that_share_one_storage_too_often() {
        // 26 views of one storage of six numbers.
        let heap = &mut Heap::default();
        let mut pickle = b"}(".to_vec();
        let one = view(b"K\0", b"K\x06\x85", b"K\x01\x85");
        for name in b'a'..=b'z' {
            pickle.extend([b'X', 1, 0, 0, 0, name]);
            pickle.extend(&one[..one.len() - 1]);
        }
        pickle.extend(b"u.");
        let object = run_with(&pickle, heap).unwrap();
        let gathered = |len| super::super::gather(heap, object, |_| Some(&[0; 24]), len);
        assert!(gathered(156).is_ok());
        let error = gathered(100).unwrap_err().to_string();
        let expected = "tensors of 156 elements together in a file of 100 bytes";
        assert_eq!(error, expected);
    }

    #[test]
    fn files_that_end_early() {
        for file in ["zip.pth", "stream.pth"] {
            let bytes = fixture(file);
            for len in 0..bytes.len() {
                assert!(crate::read(&bytes[..len]).is_err(), "{file} {len}");
            }
        }
    }

    proptest! {
        /// Whatever the bytes, an error or tensors; no panic. `tests/fuzz.rs` turns single bits.
        #[test]
        fn broken_files(
            at in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        ) {
            for file in ["zip.pth", "stream.pth"] {
                let mut bytes = fixture(file);
                for (index, value) in &at {
                    let index = index.index(bytes.len());
                    bytes[index] = *value;
                }
                let _ = crate::read(&bytes);
            }
        }

        #[test]
        fn programs_of_known_opcodes(
            opcodes in proptest::collection::vec(
                prop::sample::select(b"()tNKJMXU}]aesuqrhjcQRb.\x80\x85\x86\x87\x88\x8a\x8c\x93\x94\x95\0\x01\n0".to_vec()),
                0..400,
            ),
        ) {
            let _ = run(&opcodes);
            let stream = [&fixture("stream.pth")[..14], b".\x80\x02M\xe9\x03.", &opcodes].concat();
            let _ = crate::read(&stream);
        }
    }
}
