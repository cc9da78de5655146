//! Objects of a model file whose keys follow from the declared parameters: numbers under the keys
//! of their fields, names of forms, groups and lists.

use std::fmt;

use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::Value;
use trocar_model::{
    Blank, Choice, Elements, ParamError, Parameters, Quantity, Range, SlidingFriction, Visit,
};

use super::{ModelFileError, impossible};

/// Members of an object, in order.
#[derive(Debug, Default)]
pub(super) struct Members(Vec<(String, Member)>);

#[derive(Debug, Serialize, Deserialize)]
#[serde(untagged)]
pub(super) enum Member {
    Number(f64),
    /// `null`: JSON has no infinity.
    Infinite,
    Word(String),
    Group(Members),
    List(Vec<Members>),
    Other(Value),
}

impl fmt::Display for Member {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = serde_json::to_string(self).map_err(|_| fmt::Error)?;
        f.write_str(&text)
    }
}

impl Serialize for Members {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(key, member)| (key, member)))
    }
}

impl<'de> Deserialize<'de> for Members {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(Object)
    }
}

struct Object;

impl<'de> Visitor<'de> for Object {
    type Value = Members;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Members, A::Error> {
        let mut members = Members::default();
        while let Some((key, member)) = map.next_entry::<String, Member>()? {
            // As serde does for structs; a map would silently take the last of two.
            if members.0.iter().any(|(other, _)| *other == key) {
                return Err(A::Error::custom(format!("duplicate field `{key}`")));
            }
            members.0.push((key, member));
        }
        Ok(members)
    }
}

impl Members {
    /// The numbers of `params`.
    pub(super) fn of<T: Parameters>(params: &T) -> Self {
        let mut members = Self::default();
        members.put_fields(params);
        members
    }

    /// The numbers of `params` that are not 0.
    pub(super) fn of_nonzero<T: Parameters>(params: &T) -> Self {
        let mut members = Self::of(params);
        members.0.retain(|(_, member)| !matches!(member, Member::Number(0.0)));
        members
    }

    pub(super) fn put(&mut self, key: &str, member: Member) {
        self.0.push((key.to_owned(), member));
    }

    fn put_fields<T: Parameters>(&mut self, params: &T) {
        for field in T::FIELDS {
            self.put_number(field.key, (field.get)(params));
        }
    }

    fn put_number(&mut self, key: &str, value: f64) {
        self.put(key, if value.is_finite() { Member::Number(value) } else { Member::Infinite });
    }

    /// The parameters with these numbers and no other members.
    pub(super) fn params<T: Blank>(self, place: &str) -> Result<T, ModelFileError> {
        let mut params = T::BLANK;
        let mut reader = Reader::new(place, self);
        for field in T::FIELDS {
            let value = reader.number(field.key, field.quantity)?;
            (field.set)(&mut params, value);
        }
        reader.end()?;
        Ok(params)
    }

    /// `params` with these numbers, which may be missing, and no other members.
    pub(super) fn change<T: Parameters>(
        self,
        mut params: T,
        place: &str,
    ) -> Result<T, ModelFileError> {
        let mut reader = Reader::new(place, self);
        for field in T::FIELDS {
            if let Some(member) = reader.find(field.key) {
                let value = reader.value(field.key, field.quantity, &member)?;
                (field.set)(&mut params, value);
            }
        }
        reader.end()?;
        Ok(params)
    }
}

/// Puts the members of a model.
impl Visit for Members {
    type Error = std::convert::Infallible;

    fn number(&mut self, quantity: Quantity, value: &mut f64) -> Result<(), Self::Error> {
        self.put_number(quantity.declaration().key, *value);
        Ok(())
    }

    fn choice<T: Choice>(&mut self, chosen: &mut T) -> Result<(), Self::Error> {
        for (_, name) in T::ALL.iter().filter(|(one, _)| one == chosen) {
            self.put(T::KEY, Member::Word((*name).to_owned()));
        }
        Ok(())
    }

    fn sliding(&mut self, sliding: &mut SlidingFriction) -> Result<(), Self::Error> {
        self.put("sliding", Member::Group(Self::of(sliding)));
        Ok(())
    }

    fn elements<T: Blank>(&mut self, elements: &mut Elements<T>) -> Result<(), Self::Error> {
        self.put("elements", Member::List(elements.as_slice().iter().map(Self::of).collect()));
        Ok(())
    }
}

/// Takes members by key.
pub(super) struct Reader {
    place: String,
    members: Members,
    asked: Vec<&'static str>,
}

impl Reader {
    pub(super) fn new(place: &str, members: Members) -> Self {
        Self { place: place.to_owned(), members, asked: Vec::new() }
    }

    fn find(&mut self, key: &'static str) -> Option<Member> {
        self.asked.push(key);
        let at = self.members.0.iter().position(|(other, _)| other == key)?;
        Some(self.members.0.remove(at).1)
    }

    pub(super) fn take(&mut self, key: &'static str) -> Result<Member, ModelFileError> {
        let found = self.find(key);
        found.ok_or_else(|| impossible(&self.place, &format!("missing field `{key}`")))
    }

    fn number(&mut self, key: &'static str, quantity: Quantity) -> Result<f64, ModelFileError> {
        let member = self.take(key)?;
        self.value(key, quantity, &member)
    }

    fn value(&self, key: &str, of: Quantity, member: &Member) -> Result<f64, ModelFileError> {
        let declaration = of.declaration();
        let (range, unit) = (declaration.range, declaration.unit.si);
        match member {
            Member::Number(value) => Ok(*value),
            Member::Infinite if range == Range::AboveZeroOrInfinite => Ok(f64::INFINITY),
            other => Err(self.wrong(key, &format!("a number in {unit}"), other)),
        }
    }

    fn wrong(&self, key: &str, expected: &str, found: &Member) -> ModelFileError {
        let what = format!("must be {expected}, got {found}");
        impossible(&format!("{}.{key}", self.place), &what)
    }

    /// Refuses members that nobody has asked for.
    pub(super) fn end(self) -> Result<(), ModelFileError> {
        let Some((key, _)) = self.members.0.first() else { return Ok(()) };
        let expected: Vec<String> = self.asked.iter().map(|key| format!("`{key}`")).collect();
        let what = format!("unknown field `{key}`, expected one of {}", expected.join(", "));
        Err(impossible(&self.place, &what))
    }
}

/// Why a member is none of a model.
pub(super) enum Refused {
    Member(ModelFileError),
    Value(ParamError),
}

impl From<ModelFileError> for Refused {
    fn from(error: ModelFileError) -> Self {
        Self::Member(error)
    }
}

impl From<ParamError> for Refused {
    fn from(error: ParamError) -> Self {
        Self::Value(error)
    }
}

/// Takes the members of a model.
impl Visit for Reader {
    type Error = Refused;

    fn number(&mut self, quantity: Quantity, value: &mut f64) -> Result<(), Refused> {
        *value = Self::number(self, quantity.declaration().key, quantity)?;
        Ok(())
    }

    fn choice<T: Choice>(&mut self, chosen: &mut T) -> Result<(), Refused> {
        let found = self.take(T::KEY)?;
        let named =
            T::ALL.iter().find(|(_, name)| matches!(&found, Member::Word(word) if word == name));
        let Some((one, _)) = named else {
            let names: Vec<&str> = T::ALL.iter().map(|(_, name)| *name).collect();
            return Err(self.wrong(T::KEY, &names.join(" or "), &found).into());
        };
        *chosen = *one;
        Ok(())
    }

    fn sliding(&mut self, sliding: &mut SlidingFriction) -> Result<(), Refused> {
        let place = format!("{}.sliding", self.place);
        *sliding = match self.take("sliding")? {
            Member::Group(members) => members.params(&place)?,
            other => return Err(self.wrong("sliding", "an object", &other).into()),
        };
        Ok(())
    }

    fn elements<T: Blank>(&mut self, elements: &mut Elements<T>) -> Result<(), Refused> {
        let all = match self.take("elements")? {
            Member::List(all) => all,
            other => return Err(self.wrong("elements", "a list of objects", &other).into()),
        };
        elements.resize(all.len())?;
        let places = elements.as_mut_slice().iter_mut();
        for (i, (element, members)) in places.zip(all).enumerate() {
            *element = members.params(&format!("{}.elements[{i}]", self.place))?;
        }
        Ok(())
    }
}
