//! Templates of the C file: readable C whose lines are included conditionally.
//!
//! `//@if NAME`, `//@else` and `//@end` are on lines of their own and may be nested; `@NAME@` is a
//! value; the prefix `trocar_` of all names is replaced. A classical model's file has the members of
//! its state after `//@state`, for the header, and the rest after `//@code`.

use std::collections::BTreeSet;

/// Prefix of all names in the templates.
const PREFIX: &str = "trocar_";

/// Inputs for filling a template.
#[derive(Debug, Default)]
pub(super) struct Filling {
    /// Names of the conditions that are true.
    pub(super) features: BTreeSet<&'static str>,
    /// Values by name.
    pub(super) values: Vec<(&'static str, String)>,
}

impl Filling {
    /// Sets the condition `name` if `holds`.
    pub(super) fn set(&mut self, name: &'static str, holds: bool) {
        if holds {
            self.features.insert(name);
        }
    }

    /// Sets all conditions in `names`.
    pub(super) fn need(&mut self, names: &[&'static str]) {
        self.features.extend(names);
    }

    /// Whether the condition `name` is true.
    pub(super) fn has(&self, name: &str) -> bool {
        self.features.contains(name)
    }

    /// Sets the value for `@name@`.
    pub(super) fn value(&mut self, name: &'static str, text: impl Into<String>) {
        self.values.push((name, text.into()));
    }

    /// `template` with the lines whose conditions are true, names with `prefix`, and the values
    /// inserted.
    pub(super) fn fill(&self, template: &str, prefix: &str) -> String {
        let mut text = String::with_capacity(template.len());
        let mut conditions: Vec<bool> = Vec::new();
        for line in template.lines() {
            match line
                .strip_prefix("//@")
                .map(|condition| condition.split_once(' ').unwrap_or((condition, "")))
            {
                Some(("if", name)) => conditions.push(self.has(name)),
                Some(("else", _)) => {
                    if let Some(last) = conditions.last_mut() {
                        *last = !*last;
                    }
                }
                Some(_) => drop(conditions.pop()),
                None if conditions.iter().all(|holds| *holds) => {
                    text.push_str(&line.replace(PREFIX, &format!("{prefix}_")));
                    text.push('\n');
                }
                None => (),
            }
        }
        // Last, so that names in the values are not replaced.
        for (name, value) in &self.values {
            text = text.replace(&format!("@{name}@"), value);
        }
        text
    }
}

/// `value` in C: exactly, as a hexadecimal constant, with nine decimal digits in a comment.
pub(super) fn number(value: f64) -> String {
    if value.is_infinite() {
        return if value < 0.0 { "-HUGE_VAL".into() } else { "HUGE_VAL".into() };
    }
    let shown = format!("{value:.8e}").parse().unwrap_or(value);
    format!("{} /* {shown:?} */", hexadecimal(value))
}

/// A finite `value` as a hexadecimal constant of C99.
pub(super) fn hexadecimal(value: f64) -> String {
    const MANTISSA_BITS: u32 = 52;
    let bits = value.to_bits();
    let sign = if value.is_sign_negative() { "-" } else { "" };
    let mantissa = bits & ((1 << MANTISSA_BITS) - 1);
    let biased = ((bits >> MANTISSA_BITS) & 0x7ff) as i32;
    if biased == 0 && mantissa == 0 {
        return format!("{sign}0.0");
    }
    let (lead, exponent) = if biased == 0 { (0, -1022) } else { (1, biased - 1023) };
    let digits = format!("{mantissa:013x}");
    let digits = digits.trim_end_matches('0');
    let point = if digits.is_empty() { "" } else { "." };
    format!("{sign}0x{lead}{point}{digits}p{exponent:+}")
}

/// `text` for the inside of a comment: printable ASCII, without the comment delimiters.
pub(super) fn remark(text: &str) -> String {
    let plain: String =
        text.chars().map(|c| if matches!(c, ' '..='~') { c } else { '?' }).collect();
    plain.replace("*/", "* /").replace("/*", "/ *").replace("??/", "?? /")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_taken_by_their_conditions() {
        let template = "a\n//@if x\nb\n//@if y\nc\n//@end\n//@else\nd\n//@end\ntrocar_e @V@\n";
        let mut filling = Filling::default();
        filling.value("V", "7");
        assert_eq!(filling.fill(template, "p"), "a\nd\np_e 7\n");
        filling.need(&["x"]);
        assert_eq!(filling.fill(template, "p"), "a\nb\np_e 7\n");
        filling.need(&["y"]);
        assert_eq!(filling.fill(template, "p"), "a\nb\nc\np_e 7\n");
    }

    /// C99 constants as in the examples of the standard and from `%a` of C libraries.
    #[test]
    fn hexadecimal_constants_are_those_of_c() {
        let cases = [
            (1.0, "0x1p+0"),
            (-0.1, "-0x1.999999999999ap-4"),
            (0.0, "0.0"),
            (f64::MAX, "0x1.fffffffffffffp+1023"),
            (f64::MIN_POSITIVE, "0x1p-1022"),
            (5e-324, "0x0.0000000000001p-1022"),
        ];
        for (value, text) in cases {
            assert_eq!(hexadecimal(value), text);
        }
    }

    #[test]
    fn a_remark_cannot_end_its_comment() {
        assert_eq!(remark("a*/ int x; /*\nb ü"), "a* / int x; / *?b ?");
        assert!(!remark("/*/").contains("*/"));
    }
}
