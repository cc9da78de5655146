//! Options in messages. A library marks them, and each interface writes them in its own way.
//!
//! | marked                     | command line                    | Python                         |
//! |----------------------------|---------------------------------|--------------------------------|
//! | `‹columns›`                | `--columns`                     | `columns`                      |
//! | `‹rate_hz=1000›`           | `--rate-hz 1000`                | `rate_hz=1000`                 |
//! | `‹without=second_stage›`   | `--without second_stage`        | `without='second_stage'`       |
//! | `‹columns='force_n=the F'›`| `--columns 'force_n=the F'`     | `columns='force_n=the F'`      |
//! | `‹flip_force=True›`        | `--flip-force`                  | `flip_force=True`              |
//! | `‹shaft_diameter_mm›`      | `--shaft-diameter-mm`           | `shaft_diameter_m`             |
//! | `‹validate=...›`           | `--validate`                    | `validate=...`                 |
//! | `‹identify(posterior=N)›`  | `trocar identify --posterior N` | `trocar.identify(posterior=N)` |
//! | `‹plan_config()›`          | `trocar plan --print-config`    | `trocar.plan_config()`         |
//!
//! A value that a shell might not take as it is stands in quotes; nothing within is escaped.
//! Files of results and reports write them as the command line does.

/// What shows a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interface {
    /// The command line; also reports and tables.
    CommandLine,
    /// A text of JSON with messages in it: the same, with the quotes of a shell escaped.
    Json,
    /// Python.
    Python,
}

/// `text` with the marked options as `interface` writes them.
pub fn spelt(text: &str, interface: Interface) -> String {
    let mut spelt = String::with_capacity(text.len());
    let mut rest = text;
    while let Some((before, (marked, after))) = next_marked(rest) {
        spelt += before;
        spelt += &match interface {
            Interface::CommandLine => on_the_command_line(marked, r"'\''"),
            Interface::Json => on_the_command_line(marked, r"'\\''"),
            Interface::Python => in_python(marked),
        };
        rest = after;
    }
    spelt + rest
}

fn next_marked(text: &str) -> Option<(&str, (&str, &str))> {
    let (before, rest) = text.split_once('‹')?;
    Some((before, rest.split_once('›')?))
}

/// `apostrophe` stands for one within a quoted value.
fn on_the_command_line(marked: &str, apostrophe: &str) -> String {
    if let Some(verb) = marked.strip_suffix("_config()") {
        return format!("trocar {verb} --print-config");
    }
    if let Some((verb, option)) = call(marked) {
        return format!("trocar {verb} {}", on_the_command_line(option, apostrophe));
    }
    let (name, value) = parts(marked);
    let flag = format!("--{}", name.replace('_', "-"));
    match value {
        None | Some("True" | "...") => flag,
        Some(value) => match within_quotes(value) {
            Some(inner) => format!("{flag} '{}'", inner.replace('\'', apostrophe)),
            None => format!("{flag} {value}"),
        },
    }
}

fn in_python(marked: &str) -> String {
    if marked.ends_with("()") {
        return format!("trocar.{marked}");
    }
    if let Some((verb, option)) = call(marked) {
        return format!("trocar.{verb}({})", in_python(option));
    }
    match parts(marked) {
        // What is written has a path of its own in Python, whatever writes it.
        ("out", None) => "path".to_owned(),
        // Millimetres are for the command line.
        (name, None) => match name.strip_suffix("_mm") {
            Some(front) => format!("{front}_m"),
            None => name.to_owned(),
        },
        (name, Some(value)) if is_no_text(value) => format!("{name}={value}"),
        (name, Some(value)) => {
            let text = within_quotes(value).unwrap_or(value).replace('\\', r"\\");
            match text.contains('\'') {
                true => format!("{name}=\"{}\"", text.replace('"', "\\\"")),
                false => format!("{name}='{text}'"),
            }
        }
    }
}

/// The verb and the option of `verb(option)`.
fn call(marked: &str) -> Option<(&str, &str)> {
    let (verb, option) = marked.strip_suffix(')')?.split_once('(')?;
    let is_name = verb.bytes().all(|byte| byte.is_ascii_lowercase());
    is_name.then_some((verb, option))
}

/// Name and value of an option.
fn parts(marked: &str) -> (&str, Option<&str>) {
    marked.split_once('=').map_or((marked, None), |(name, value)| (name, Some(value)))
}

fn within_quotes(value: &str) -> Option<&str> {
    value.strip_prefix('\'')?.strip_suffix('\'')
}

/// A number, a name of Python, or what stands for one.
fn is_no_text(value: &str) -> bool {
    let is_placeholder = value.bytes().all(|byte| byte.is_ascii_uppercase());
    is_placeholder || matches!(value, "True" | "...") || value.parse::<f64>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn are(marked: &str, on_the_command_line: &str, in_python: &str) {
        assert_eq!(spelt(marked, Interface::CommandLine), on_the_command_line);
        assert_eq!(spelt(marked, Interface::Python), in_python);
    }

    #[test]
    fn each_interface_writes_options_in_its_own_way() {
        are("use ‹flip_force=True›, or", "use --flip-force, or", "use flip_force=True, or");
        are("‹from_s=10› ‹to_s=60›", "--from-s 10 --to-s 60", "from_s=10 to_s=60");
        are("(‹offset_n›)", "(--offset-n)", "(offset_n)");
        are("‹shaft_diameter_mm› takes", "--shaft-diameter-mm takes", "shaft_diameter_m takes");
        are("‹validate=...›, or", "--validate, or", "validate=..., or");
        are(
            "‹identify(posterior=N)› writes",
            "trocar identify --posterior N writes",
            "trocar.identify(posterior=N) writes",
        );
        are("‹plan_config()›", "trocar plan --print-config", "trocar.plan_config()");
    }

    #[test]
    fn values_can_be_pasted() {
        are(
            "‹columns=time_s,position_mm›",
            "--columns time_s,position_mm",
            "columns='time_s,position_mm'",
        );
        are(
            "‹columns='force_n=-it's, \"f\"'›",
            r#"--columns 'force_n=-it'\''s, "f"'"#,
            r#"columns="force_n=-it's, \"f\"""#,
        );
    }

    #[test]
    fn json_stays_json() {
        let spelt = spelt(r#"{"hint": "‹columns='it's, \"f\"'›"}"#, Interface::Json);
        assert_eq!(spelt, r#"{"hint": "--columns 'it'\\''s, \"f\"'"}"#);
    }

    #[test]
    fn text_without_options_stays() {
        for text in ["1 < 2 › 1", "a ‹b", ""] {
            are(text, text, text);
        }
    }
}
