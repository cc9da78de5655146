//! JSON objects that hold the numbers of a parameter struct under the keys of its fields
//! ([`Parameters::FIELDS`]), beside other members.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{Error, MapAccess, Visitor};
use serde::ser::SerializeMap;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use trocar_model::{Blank, Parameters, Range};

/// Members of an object besides its numbers.
pub(super) trait Members: Default {
    /// Their keys.
    const KEYS: &'static [&'static str];
    /// Whether every number must be there; otherwise a missing one is zero, and zeros are not
    /// written.
    const ALL_NUMBERS: bool = true;

    /// Reads the value of `key`, one of [`Members::KEYS`].
    fn read<'de, A: MapAccess<'de>>(&mut self, key: &str, map: &mut A) -> Result<(), A::Error>;

    /// An error for a member that is missing.
    fn check<E: Error>(&self) -> Result<(), E>;

    fn write<M: SerializeMap>(&self, map: &mut M) -> Result<(), M::Error>;
}

impl Members for () {
    const KEYS: &'static [&'static str] = &[];

    fn read<'de, A: MapAccess<'de>>(&mut self, _: &str, _: &mut A) -> Result<(), A::Error> {
        Ok(())
    }

    fn check<E: Error>(&self) -> Result<(), E> {
        Ok(())
    }

    fn write<M: SerializeMap>(&self, _: &mut M) -> Result<(), M::Error> {
        Ok(())
    }
}

/// Declares a struct of members; one marked `[optional]` may be missing.
macro_rules! members {
    (@check $self:ident $name:ident [optional]) => {};
    (@check $self:ident $name:ident) => {
        if $self.$name.is_none() {
            return Err(E::missing_field(stringify!($name)));
        }
    };
    ($type:ident $([$all:ident = $is_all:literal])? { $($name:ident $([$optional:ident])?: $value:ty),* $(,)? }) => {
        #[derive(Default)]
        pub(super) struct $type {
            $($name: Option<$value>),*
        }

        impl $crate::model_file::object::Members for $type {
            const KEYS: &'static [&'static str] = &[$(stringify!($name)),*];
            $(const $all: bool = $is_all;)?

            fn read<'de, A: serde::de::MapAccess<'de>>(&mut self, key: &str, map: &mut A) -> Result<(), A::Error> {
                $(if key == stringify!($name) {
                    if self.$name.is_some() {
                        return Err(serde::de::Error::duplicate_field(stringify!($name)));
                    }
                    self.$name = Some(map.next_value()?);
                })*
                Ok(())
            }

            fn check<E: serde::de::Error>(&self) -> Result<(), E> {
                $(members!(@check self $name $([$optional])?);)*
                Ok(())
            }

            fn write<M: serde::ser::SerializeMap>(&self, map: &mut M) -> Result<(), M::Error> {
                $(if let Some(value) = &self.$name {
                    map.serialize_entry(stringify!($name), value)?;
                })*
                Ok(())
            }
        }
    };
}

pub(super) use members;

/// A member that [`Members::check`] has found.
pub(super) fn found<T>(member: Option<T>) -> T {
    member.expect("reading checks that every member is there")
}

/// An object with the numbers of `T` and further members.
pub(super) struct Object<T, M = ()> {
    /// Values in the order of the fields; `None` for a missing one.
    values: Vec<Option<f64>>,
    pub(super) members: M,
    of: PhantomData<T>,
}

impl<T: Parameters, M> Object<T, M> {
    pub(super) fn new(params: &T, members: M) -> Self {
        Self { values: params.numbers().map(Some).collect(), members, of: PhantomData }
    }

    /// `base` with the numbers of the object.
    pub(super) fn fill(&self, mut base: T) -> T {
        for (field, value) in T::FIELDS.iter().zip(&self.values) {
            value.iter().for_each(|value| (field.set)(&mut base, *value));
        }
        base
    }
}

impl<T: Parameters> From<&T> for Object<T> {
    fn from(params: &T) -> Self {
        Self::new(params, ())
    }
}

impl<T: Blank, M> Object<T, M> {
    /// The numbers alone.
    pub(super) fn params(&self) -> T {
        self.fill(T::BLANK)
    }
}

impl<T: Parameters, M: Members> Serialize for Object<T, M> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        self.members.write(&mut map)?;
        for (field, value) in T::FIELDS.iter().zip(&self.values) {
            // JSON has no infinity: `null`.
            match value.filter(|value| value.is_finite()) {
                Some(0.0) if !M::ALL_NUMBERS => {}
                value => map.serialize_entry(field.key, &value)?,
            }
        }
        map.end()
    }
}

impl<'de, T: Parameters, M: Members> Deserialize<'de> for Object<T, M> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(Reader(PhantomData))
    }
}

struct Reader<T, M>(PhantomData<(T, M)>);

impl<'de, T: Parameters, M: Members> Visitor<'de> for Reader<T, M> {
    type Value = Object<T, M>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
        let mut object =
            Object { values: vec![None; T::FIELDS.len()], members: M::default(), of: PhantomData };
        while let Some(key) = map.next_key::<String>()? {
            if M::KEYS.contains(&key.as_str()) {
                object.members.read(&key, &mut map)?;
            } else {
                object.read_number(&key, &mut map)?;
            }
        }
        object.members.check()?;
        let missing = T::FIELDS
            .iter()
            .zip(&object.values)
            .find(|(_, value)| M::ALL_NUMBERS && value.is_none());
        match missing {
            Some((field, _)) => Err(A::Error::missing_field(field.key)),
            None => Ok(object),
        }
    }
}

impl<T: Parameters, M: Members> Object<T, M> {
    fn read_number<'de, A: MapAccess<'de>>(
        &mut self,
        key: &str,
        map: &mut A,
    ) -> Result<(), A::Error> {
        let Some(place) = T::FIELDS.iter().position(|field| field.key == key) else {
            let keys = M::KEYS.iter().copied().chain(T::FIELDS.iter().map(|field| field.key));
            let expected: Vec<String> = keys.map(|key| format!("`{key}`")).collect();
            return Err(A::Error::custom(format!(
                "unknown field `{key}`, expected one of {}",
                expected.join(", ")
            )));
        };
        let field = &T::FIELDS[place];
        if self.values[place].is_some() {
            return Err(A::Error::duplicate_field(field.key));
        }
        let may_be_infinite = field.quantity.declaration().range == Range::AboveZeroOrInfinite;
        self.values[place] = Some(if may_be_infinite {
            map.next_value::<Option<f64>>()?.unwrap_or(f64::INFINITY)
        } else {
            map.next_value()?
        });
        Ok(())
    }
}
