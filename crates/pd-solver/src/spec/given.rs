//! How files write sets and bodies: a list, a table or a name. Not derived, because serde's own error for an untagged enum does not tell what is
//! wrong with a table.

use super::{ElementSet, NodeSet, Obstacle};
use hex_mesh::NodeRegion;
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Error, IgnoredAny, MapAccess, SeqAccess, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt::Formatter;
use std::marker::PhantomData;

const NODES: &str =
    "a region such as { type = \"box\", min = [..], max = [..] }, or a list of node indices";
const ELEMENTS: &str =
    "a region such as { type = \"box\", min = [..], max = [..] }, a share per element, or a name";
const OBSTACLE: &str =
    "an obstacle such as { type = \"plane\", normal = [..], offset = .. }, or a name";

/// What stands in a file.
enum Given<L, T> {
    List(Vec<L>),
    Table(T),
    Name(String),
}

/// Reads what there is; `expected` is what errors ask for.
fn given<'de, L: Deserialize<'de>, T: ReadTable<'de>, D: Deserializer<'de>>(
    deserializer: D,
    expected: &'static str,
) -> Result<Given<L, T>, D::Error> {
    struct Any<L, T>(&'static str, PhantomData<(L, T)>);
    impl<'de, L: Deserialize<'de>, T: ReadTable<'de>> Visitor<'de> for Any<L, T> {
        type Value = Given<L, T>;

        fn expecting(&self, f: &mut Formatter) -> std::fmt::Result {
            f.write_str(self.0)
        }

        fn visit_str<E: Error>(self, name: &str) -> Result<Self::Value, E> {
            Ok(Given::Name(name.into()))
        }

        fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<Self::Value, A::Error> {
            Vec::deserialize(SeqAccessDeserializer::new(list)).map(Given::List)
        }

        fn visit_map<A: MapAccess<'de>>(self, table: A) -> Result<Self::Value, A::Error> {
            T::read_table(MapAccessDeserializer::new(table)).map(Given::Table)
        }
    }
    deserializer.deserialize_any(Any(expected, PhantomData))
}

/// What a table holds.
trait ReadTable<'de>: Sized {
    fn read_table<D: Deserializer<'de>>(table: D) -> Result<Self, D::Error>;
}

impl<'de> ReadTable<'de> for NodeRegion {
    fn read_table<D: Deserializer<'de>>(table: D) -> Result<Self, D::Error> {
        Self::deserialize(table)
    }
}

impl<'de> ReadTable<'de> for Obstacle {
    fn read_table<D: Deserializer<'de>>(table: D) -> Result<Self, D::Error> {
        // The derived one, see `serde(remote)` there.
        Self::deserialize(table)
    }
}

impl<'de> Deserialize<'de> for NodeSet {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match given(deserializer, NODES)? {
            Given::List(list) => Ok(Self::Indices(list)),
            Given::Table(region) => Ok(Self::Region(region)),
            Given::Name(name) => Err(D::Error::invalid_type(Unexpected::Str(&name), &NODES)),
        }
    }
}

impl<'de> Deserialize<'de> for ElementSet {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Ok(match given(deserializer, ELEMENTS)? {
            Given::List(list) => Self::Painted(list),
            Given::Table(region) => Self::Region(region),
            Given::Name(name) => Self::Named(name),
        })
    }
}

impl<'de> Deserialize<'de> for Obstacle {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match given::<IgnoredAny, Self, D>(deserializer, OBSTACLE)? {
            Given::List(_) => Err(D::Error::invalid_type(Unexpected::Seq, &OBSTACLE)),
            Given::Table(obstacle) => Ok(obstacle),
            Given::Name(name) => Ok(Self::Named { name }),
        }
    }
}

impl Serialize for Obstacle {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        // The derived one, see `serde(remote)` there.
        Self::serialize(self, serializer)
    }
}
