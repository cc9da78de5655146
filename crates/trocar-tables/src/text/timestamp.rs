//! Dates with times of day in text, such as `2026-11-22T10:15:00.123+01:00` (ISO 8601), and as
//! measuring programs write them: `2026/11/22 10:15:00`, `22.11.2026 10:15:00`, `10:15:00.123`.

/// Nanoseconds since 1970 of a date with a time of day, in UTC if it has no zone; of a time of day
/// alone since midnight; `None` for other text.
pub fn parse(cell: &[u8]) -> Option<i64> {
    let mut rest = cell.trim_ascii();
    let (year, month, day) = match date(&mut rest) {
        Some(date) => {
            take(&mut rest, b"Tt ")?;
            rest = rest.trim_ascii_start();
            date
        }
        None => (1970, 1, 1),
    };
    // Without a date, seconds tell the time of day from other numbers with a colon.
    let is_alone = rest.len() == cell.trim_ascii().len();
    let hour = number(&mut rest, 2)?;
    take(&mut rest, b":")?;
    let minute = number(&mut rest, 2)?;
    let second = match take(&mut rest, b":") {
        Some(()) => number(&mut rest, 2)?,
        None if is_alone => return None,
        None => 0,
    };
    let fraction = if take(&mut rest, b".,").is_some() { nanoseconds(&mut rest)? } else { 0 };
    let zone = zone(rest.trim_ascii_start())?;
    let possible = (1..=12).contains(&month)
        && (1..=31).contains(&day)
        && hour < 25
        && minute < 60
        && second < 61;
    let minutes = (days(year, month, day) * 24 + hour) * 60 + minute - zone;
    // 64 bits hold the years 1678 to 2262.
    let whole = (minutes * 60 + second).checked_mul(1_000_000_000).filter(|_| possible)?;
    whole.checked_add(fraction)
}

/// Year, month and day: `2026-11-22`, `2026/11/22` or `22.11.2026`. With slashes the year comes
/// first: otherwise countries differ in which number is the month.
fn date(rest: &mut &[u8]) -> Option<(i64, i64, i64)> {
    let mut own = *rest;
    let date = if own.get(2) == Some(&b'.') {
        let day = number(&mut own, 2)?;
        take(&mut own, b".")?;
        let month = number(&mut own, 2)?;
        take(&mut own, b".")?;
        (number(&mut own, 4)?, month, day)
    } else {
        let year = number(&mut own, 4)?;
        let sign = *own.first().filter(|sign| b"-/".contains(sign))?;
        take(&mut own, &[sign])?;
        let month = number(&mut own, 2)?;
        take(&mut own, &[sign])?;
        (year, month, number(&mut own, 2)?)
    };
    *rest = own;
    Some(date)
}

/// Whether two cells of a text separated by blanks are one date with its time of day.
pub(super) fn belong_together(before: &[u8], time: &[u8]) -> bool {
    let is_date = date(&mut &*before).is_some() && before.len() == 10;
    is_date && time.get(2) == Some(&b':') && parse(&[before, b" ", time].concat()).is_some()
}

fn take(rest: &mut &[u8], any: &[u8]) -> Option<()> {
    let (first, others) = rest.split_first()?;
    any.contains(first).then(|| *rest = others)
}

fn number(rest: &mut &[u8], digits: usize) -> Option<i64> {
    let (own, others) = rest.split_at_checked(digits)?;
    *rest = others;
    own.iter().try_fold(0, |number, digit| {
        digit.is_ascii_digit().then(|| 10 * number + i64::from(digit - b'0'))
    })
}

/// The digits of a fraction of a second; those beyond nanoseconds have no effect.
fn nanoseconds(rest: &mut &[u8]) -> Option<i64> {
    let count = rest.iter().take_while(|byte| byte.is_ascii_digit()).count();
    let (own, others) = rest.split_at(count);
    *rest = others;
    let digits =
        own.iter().map(|digit| i64::from(digit - b'0')).chain(std::iter::repeat(0)).take(9);
    (count > 0).then(|| digits.fold(0, |number, digit| 10 * number + digit))
}

/// Minutes east of UTC.
fn zone(mut rest: &[u8]) -> Option<i64> {
    let sign = match rest.split_first() {
        None => return Some(0),
        Some((b'Z' | b'z', others)) => return others.is_empty().then_some(0),
        Some((b'+', others)) => {
            rest = others;
            1
        }
        Some((b'-', others)) => {
            rest = others;
            -1
        }
        Some(_) => return None,
    };
    let hours = number(&mut rest, 2)?;
    take(&mut rest, b":");
    let minutes = if rest.is_empty() { 0 } else { number(&mut rest, 2)? };
    rest.is_empty().then_some(sign * (60 * hours + minutes))
}

/// Days since 1970-01-01 in the Gregorian calendar; years begin in March, so that leap days are the
/// last of theirs.
fn days(year: i64, month: i64, day: i64) -> i64 {
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    365 * year + year / 4 - year / 100 + year / 400 + (153 * month + 2) / 5 + day - 1 - 719_468
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_nanoseconds_since_1970() {
        for (text, seconds) in [
            ("1970-01-01T00:00:00", 0.0),
            ("2000-03-01T00:00:00Z", 951_868_800.0),
            ("2024-02-29 23:59:59.5", 1_709_251_199.5),
            ("2026-11-22T10:15:00.123", 1_795_342_500.123),
            ("2026-11-22T10:15:00,123+01:00", 1_795_338_900.123),
            ("2026-11-22 10:15:00.123 -0530", 1_795_362_300.123),
            ("2026-11-22t10:15", 1_795_342_500.0),
            ("1969-12-31T23:59:59", -1.0),
            ("2026/11/22 10:15:00.123", 1_795_342_500.123),
            ("22.11.2026 10:15:00,123", 1_795_342_500.123),
            ("00:00:01.5", 1.5),
            ("10:15:00", 36_900.0),
        ] {
            assert_eq!(
                parse(text.as_bytes()),
                Some((seconds * 1e3_f64).round() as i64 * 1_000_000),
                "{text}"
            );
        }
        assert_eq!(parse(b"2026-11-22T10:15:00.000000001"), Some(1_795_342_500_000_000_001));
    }

    #[test]
    fn other_text_is_no_date() {
        for text in [
            "",
            "2026",
            "2026-11-22",
            "2026-13-22T10:15:00",
            "2026-11-22T10:15:00x",
            "-1",
            "22/11/2026 10:15:00",
            "11/22/2026 10:15:00 AM",
            "32.11.2026 10:15:00",
            "2026-11/22 10:15:00",
            "10:15",
            "10:15.5",
            "01:10:15:00",
            "9999-12-31T00:00:00",
            "2026-11-22T10:15:00.",
        ] {
            assert_eq!(parse(text.as_bytes()), None, "{text}");
        }
    }
}
