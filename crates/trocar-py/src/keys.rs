//! Configurations with keys of Python in them.

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map as Object, Value, json};

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
