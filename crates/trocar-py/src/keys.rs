//! Configurations with keys of Python in them.

use std::fmt::Display;

use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map as Object, Value, json};

use crate::errors::{ParameterError, in_python};

/// What the document `text` describes, with the name of its file in messages.
pub(crate) fn document<C, E: Display>(
    text: &str,
    name: Option<&str>,
    parse: fn(&str) -> Result<C, E>,
    error: fn(String) -> PyErr,
) -> PyResult<C> {
    parse(text).map_err(|why| match name {
        Some(name) => error(in_python(&format_args!("{name}: {why}"))),
        None => error(in_python(&why)),
    })
}

/// `config` with the keys of the nested object `changes`, JSON, one by one, so that a message names the key; `syntax`
/// makes an error of it.
pub(crate) fn changed<C: Serialize + DeserializeOwned, E>(
    mut config: C,
    changes: &str,
    syntax: fn(String) -> E,
) -> Result<C, E> {
    let named = |name: &str| {
        let name = name.to_owned();
        move |error: serde_json::Error| syntax(format!("{name}: {error}"))
    };
    let changes: Object<String, Value> = serde_json::from_str(changes).map_err(named("config"))?;
    for (key, value) in changes {
        match value {
            Value::Object(inner) if !inner.is_empty() => {
                for (own, value) in inner {
                    let name = format!("{key}.{own}");
                    config = with(&config, &key, json!({ (own): value })).map_err(named(&name))?;
                }
            }
            value => config = with(&config, &key, value).map_err(named(&key))?,
        }
    }
    Ok(config)
}

/// The keywords of a call as options, by their names.
pub(crate) fn given<O: Default + Serialize + DeserializeOwned>(
    keywords: &Bound<'_, PyDict>,
) -> PyResult<O> {
    let py = keywords.py();
    let error = py.get_type::<ParameterError>();
    let as_json = py.import(intern!(py, "trocar._keys"))?.getattr(intern!(py, "as_json"))?;
    let text: String = as_json.call1((keywords, error))?.extract()?;
    changed(O::default(), &text, ParameterError::new_err)
}

/// `config` with the value of one key; an object changes only the keys that it has.
fn with<C: Serialize + DeserializeOwned>(
    config: &C,
    key: &str,
    value: Value,
) -> serde_json::Result<C> {
    let mut all = serde_json::to_value(config)?;
    match (all.get_mut(key), value) {
        (Some(Value::Object(old)), Value::Object(new)) => old.extend(new),
        (_, value) => all[key] = value,
    }
    serde_json::from_value(all)
}
