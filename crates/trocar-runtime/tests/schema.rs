//! `schema/model.schema.json` against the declared parameters: keys, ranges, and which are
//! required.

use std::collections::BTreeSet;

use serde_json::{Value, json};
use trocar_model::{
    BoucWenParams, DahlParams, ElementParams, GmsElement, LeuvenParams, LuGreParams, Parameters,
    Range, RelaxationArm, Rotation, SealDamping, SlidingFriction, SlipElement,
};

const SCHEMA: &str = include_str!("../../../schema/model.schema.json");

/// The object of the schema at `place` must list the numbers of `T`, and no other.
fn lists<T: Parameters>(schema: &Value, place: &str, required: bool) {
    let object = schema.pointer(place).unwrap_or_else(|| panic!("{place} is there"));
    let listed = object["properties"].as_object().expect("properties");
    let keys = |names: &Value| -> BTreeSet<String> {
        names
            .as_array()
            .into_iter()
            .flatten()
            .filter_map(Value::as_str)
            .map(str::to_owned)
            .collect()
    };
    let is_number = |value: &Value| {
        keys(&json!([value["type"]])).contains("number") || value["type"].is_array()
    };
    let numbers: BTreeSet<&str> =
        listed.iter().filter(|(_, value)| is_number(value)).map(|(key, _)| key.as_str()).collect();
    let declared: BTreeSet<&str> = T::FIELDS.iter().map(|field| field.key).collect();
    assert_eq!(numbers, declared, "{place}");
    for field in T::FIELDS {
        let (found, range) = (&listed[field.key], field.quantity.declaration().range);
        let (kind, minimum, above) = match range {
            Range::Any => (json!("number"), Value::Null, Value::Null),
            Range::AtLeast(least) => (json!("number"), json!(least), Value::Null),
            Range::AboveZero => (json!("number"), Value::Null, json!(0.0)),
            Range::AboveZeroOrInfinite => (json!(["number", "null"]), Value::Null, json!(0.0)),
        };
        let number = |value: &Value| value.as_f64();
        assert_eq!(found["type"], kind, "{place}/{}", field.key);
        assert_eq!(number(&found["minimum"]), number(&minimum), "{place}/{}", field.key);
        assert_eq!(number(&found["exclusiveMinimum"]), number(&above), "{place}/{}", field.key);
        assert_eq!(
            keys(&object["required"]).contains(field.key),
            required,
            "{place}/{}",
            field.key
        );
    }
}

#[test]
fn the_schema_lists_the_declared_parameters() {
    let schema: Value = serde_json::from_str(SCHEMA).expect("the schema is JSON");
    lists::<ElementParams>(&schema, "/$defs/element", false);
    lists::<RelaxationArm>(&schema, "/$defs/element/properties/relaxation/items", true);
    lists::<Rotation>(&schema, "/$defs/rotation", true);
    lists::<SealDamping>(&schema, "/$defs/seal_damping", true);
    lists::<SlidingFriction>(&schema, "/$defs/sliding", true);
    lists::<DahlParams>(&schema, "/$defs/dahl", true);
    lists::<BoucWenParams>(&schema, "/$defs/bouc_wen", true);
    lists::<LuGreParams>(&schema, "/$defs/lugre", true);
    lists::<LeuvenParams>(&schema, "/$defs/leuven", true);
    lists::<SlipElement>(&schema, "/$defs/slip_elements/items", true);
    lists::<GmsElement>(&schema, "/$defs/gms/properties/elements/items", true);
}
