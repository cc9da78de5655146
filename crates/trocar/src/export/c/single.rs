//! C code in single precision: every `double` becomes a `float`, with its constants and functions.

use super::CError;
use super::template::hexadecimal;

/// Words of the code in double precision, and what takes their place.
const WORDS: [(&str, &str); 8] = [
    ("double", "float"),
    ("HUGE_VAL", "INFINITY"),
    ("exp", "expf"),
    ("fabs", "fabsf"),
    ("floor", "floorf"),
    ("log", "logf"),
    ("log1p", "log1pf"),
    ("sqrt", "sqrtf"),
];

/// `code` in single precision. Comments and lines of the preprocessor stay as they are.
///
/// # Errors
/// [`CError::Single`] for a constant that is not in the range of a `float`.
pub(super) fn to_single(code: &str) -> Result<String, CError> {
    let mut text = String::with_capacity(code.len());
    let mut rest = code;
    while let Some(first) = rest.chars().next() {
        let begins_line = text.is_empty() || text.ends_with('\n');
        let length = if rest.starts_with("/*") {
            rest.find("*/").map_or(rest.len(), |end| end + 2)
        } else if first == '#' && begins_line {
            end_of_directive(rest)
        } else if first.is_ascii_alphanumeric() || first == '_' {
            let length = end_of_token(rest);
            text.push_str(&token(&rest[..length])?);
            rest = &rest[length..];
            continue;
        } else {
            first.len_utf8()
        };
        text.push_str(&rest[..length]);
        rest = &rest[length..];
    }
    Ok(text)
}

/// The end of a directive, with the lines that continue it.
fn end_of_directive(text: &str) -> usize {
    let mut end = 0;
    for line in text.split_inclusive('\n') {
        end += line.len();
        if !line.ends_with("\\\n") {
            break;
        }
    }
    end
}

/// The end of an identifier or number; the sign of an exponent belongs to the number.
fn end_of_token(text: &str) -> usize {
    let bytes = text.as_bytes();
    let is_number = bytes[0].is_ascii_digit();
    let exponent: &[u8] = if text.starts_with("0x") { b"pP" } else { b"eE" };
    let goes_on = |k: usize| {
        let byte = bytes[k];
        byte.is_ascii_alphanumeric()
            || byte == b'_'
            || (is_number && byte == b'.')
            || (is_number && matches!(byte, b'+' | b'-') && exponent.contains(&bytes[k - 1]))
    };
    (1..bytes.len()).find(|k| !goes_on(*k)).unwrap_or(bytes.len())
}

fn token(token: &str) -> Result<String, CError> {
    if let Some((_, single)) = WORDS.iter().find(|(word, _)| *word == token) {
        return Ok((*single).to_owned());
    }
    let is_number = token.starts_with(|c: char| c.is_ascii_digit());
    let is_hexadecimal = token.starts_with("0x");
    let is_floating = if is_hexadecimal { token.contains('p') } else { token.contains(['.', 'e']) };
    if !is_number || !is_floating {
        return Ok(token.to_owned());
    }
    let value = if is_hexadecimal { value_of(token) } else { token.parse().ok() };
    let value = value.ok_or_else(|| CError::Single { constant: token.to_owned() })?;
    let single = value as f32;
    if single.is_infinite() || (value != 0.0 && single.abs() < f32::MIN_POSITIVE) {
        return Err(CError::Single { constant: format!("{value:e}") });
    }
    let written = if is_hexadecimal { hexadecimal(f64::from(single)) } else { token.to_owned() };
    Ok(format!("{written}f"))
}

/// The value of a hexadecimal constant as [`hexadecimal`] writes it, without sign.
fn value_of(token: &str) -> Option<f64> {
    let (mantissa, exponent) = token.strip_prefix("0x")?.split_once('p')?;
    let (lead, digits) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let bits = u64::from_str_radix(&format!("{lead}{digits}"), 16).ok()?;
    let exponent: i32 = exponent.parse().ok()?;
    let shift = exponent - 4 * i32::try_from(digits.len()).ok()?;
    // In two factors, so that neither is below the smallest double.
    Some(bits as f64 * 2_f64.powi(shift / 2) * 2_f64.powi(shift - shift / 2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_and_functions_get_their_suffix() {
        let code = "#if 1.0 \\\n  1.0\ndouble a[2] = { 0x1.999999999999ap-4 /* 0.1 */, -1e-3 };\n\
                    int b0 = 7; s[1] = fabs(1.5 * x) + HUGE_VAL - 0x3f3504f3u; t = 2.0/3.0-1.0;";
        let single = "#if 1.0 \\\n  1.0\nfloat a[2] = { 0x1.99999ap-4f /* 0.1 */, -1e-3f };\n\
                      int b0 = 7; s[1] = fabsf(1.5f * x) + INFINITY - 0x3f3504f3u; t = 2.0f/3.0f-1.0f;";
        assert_eq!(to_single(code).unwrap(), single);
    }

    #[test]
    fn constants_are_rounded_to_nearest() {
        for value in [1.0, 0.1, 1e30, 1e-30, 123_456_789.0, f64::from(f32::MAX)] {
            let single = to_single(&hexadecimal(value)).unwrap();
            let exact = value_of(single.trim_end_matches('f')).unwrap();
            assert_eq!(exact, f64::from(value as f32));
        }
    }

    #[test]
    fn constants_out_of_range_are_refused() {
        for value in [1e39, 1e-39, f64::MAX, 5e-324] {
            let error = to_single(&hexadecimal(value)).unwrap_err().to_string();
            assert!(error.contains("single precision"), "{error}");
        }
    }
}
