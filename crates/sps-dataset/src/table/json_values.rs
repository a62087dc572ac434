use super::json_node::{Entries, Node};
use super::keyed::{Touch, Values};
use super::property_of_column;
use crate::error::Fault;
use crate::tactile::is_plausible;
use crate::{Property, PropertyOrder};

/// What the values of a row are: the order that was given, or else the properties that the
/// objects of the document name.
pub(super) struct Columns<'a> {
    order: Option<&'a PropertyOrder>,
    named: Vec<Property>,
}

impl<'a> Columns<'a> {
    pub(super) fn new(order: Option<&'a PropertyOrder>) -> Self {
        Self {
            order,
            named: Vec::new(),
        }
    }

    /// Takes note of the properties that an object names.
    pub(super) fn note<'b>(
        &mut self,
        names: impl IntoIterator<Item = &'b str>,
    ) -> Result<(), Fault> {
        for name in names {
            let property = property_of_column(name)?;
            match self.order {
                Some(order) if order.position(&property).is_none() => {
                    let expected = "only properties of `property-order`";
                    return Err(Fault::unexpected("its keys", name, expected));
                }
                Some(_) => {}
                None if self.named.contains(&property) => {}
                None => self.named.push(property),
            }
        }
        Ok(())
    }

    pub(super) fn properties(&self) -> &[Property] {
        self.order.map_or(&self.named, |order| order)
    }

    /// The values of an object; a property that it does not have was not measured.
    pub(super) fn of_object(&self, entries: &Entries) -> Result<Values, Fault> {
        let value = |property: &Property| {
            let mut named = entries.iter().filter(|(name, _)| name == property.code());
            match (named.next(), named.next()) {
                (Some((_, node)), None) => measured(property, node),
                (None, _) => Ok(None),
                (Some((name, _)), Some(_)) => {
                    let found = format!("`{name}` twice");
                    Err(Fault::unexpected("its keys", found, "it once"))
                }
            }
        };
        self.properties().iter().map(value).collect()
    }

    /// The touches of one entry: an object or a list of values is one, a list of those the repeats
    /// at one location, and a list of such lists the locations.
    pub(super) fn touches(&self, node: &Node) -> Result<Vec<Touch>, Fault> {
        match node {
            Node::Object(entries) => Ok(vec![(0, 0, self.of_object(entries)?)]),
            Node::List(list) => match depth(list) {
                1 => Ok(vec![(0, 0, self.of_list(list)?)]),
                2 => self.repeats(0, list),
                _ => {
                    let locations = (0..).zip(list);
                    let touches = locations.map(|(at, node)| self.repeats(at, node.as_list()?));
                    Ok(touches.collect::<Result<Vec<_>, _>>()?.concat())
                }
            },
            other => {
                let expected = "an object or a list of values, of repeats or of locations";
                Err(Fault::unexpected("an entry", other, expected))
            }
        }
    }

    fn repeats(&self, location: u32, list: &[Node]) -> Result<Vec<Touch>, Fault> {
        let repeats = (0..).zip(list);
        let touches = repeats.map(|(at, node)| Ok((location, at, self.of_list(node.as_list()?)?)));
        touches.collect()
    }

    fn of_list(&self, list: &[Node]) -> Result<Values, Fault> {
        let order = self.order.ok_or_else(Fault::no_property_order)?;
        if list.len() != order.len() {
            let expected = format!("{}, one per entry of `property-order`", order.len());
            let what = "the length of a list";
            return Err(Fault::unexpected(what, list.len(), expected));
        }
        let values = order.iter().zip(list);
        let values = values.map(|(property, node)| measured(property, node));
        values.collect()
    }
}

impl Node {
    fn as_list(&self) -> Result<&[Self], Fault> {
        match self {
            Self::List(list) => Ok(list),
            other => Err(Fault::unexpected("an entry", other, "a list")),
        }
    }
}

/// How many lists are inside one another, judged by the first item of each.
fn depth(list: &[Node]) -> usize {
    match list.first() {
        Some(Node::List(inner)) => 1 + depth(inner),
        _ => 1,
    }
}

fn measured(property: &Property, node: &Node) -> Result<Option<f64>, Fault> {
    match node {
        Node::Null => Ok(None),
        Node::Number(value) if is_plausible(*value) => Ok(Some(*value)),
        other => {
            let expected = "a number within 1e9 of 0, or null";
            Err(Fault::not_a_number(property, other, expected))
        }
    }
}
