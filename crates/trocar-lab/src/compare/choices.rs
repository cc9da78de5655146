//! Lists of friction models as text: `ems,lugre,gms:4-10`.

use trocar_model::MAX_ELEMENTS;

use super::Choice;

impl Choice {
    /// Parses a comma-separated list of families, `all`, or banks with a number or a range of
    /// elements (`gms:4-10`). Duplicates count once.
    ///
    /// # Errors
    /// A sentence with what was found and what is allowed.
    pub fn list(text: &str) -> Result<Vec<Self>, String> {
        let mut all: Vec<Self> = Vec::new();
        for item in text.split(',') {
            all.extend(choices(item.trim())?);
        }
        all.sort();
        all.dedup();
        Ok(all)
    }
}

/// One item: `all`, a family with its usual numbers of elements, or a family with a number or a
/// range of its own.
fn choices(item: &str) -> Result<Vec<Choice>, String> {
    let usual = Choice::all();
    if item == "all" {
        return Ok(usual);
    }
    let (name, count) =
        item.split_once(':').map_or((item, None), |(name, count)| (name, Some(count)));
    let own: Vec<Choice> = usual.iter().filter(|choice| choice.family() == name).copied().collect();
    let Some(first) = own.first() else { return Err(unknown(item, &usual)) };
    let Some(count) = count else { return Ok(own) };
    let kind = match *first {
        Choice::Classical(kind) if first.is_bank() => kind,
        _ => return Err(format!("{name} has no number of elements, found {item:?}")),
    };
    let numbers = numbers(count).ok_or_else(|| {
        format!("expected {name}:N or {name}:A-B with 1 to {MAX_ELEMENTS} elements, found {item:?}")
    })?;
    Ok(numbers.map(|n| Choice::Classical(kind.with_elements(n))).collect())
}

/// The numbers of elements that `N` or `A-B` names.
fn numbers(text: &str) -> Option<std::ops::RangeInclusive<usize>> {
    let (low, high) = text.split_once('-').unwrap_or((text, text));
    let (low, high) = (low.parse().ok()?, high.parse().ok()?);
    (1 <= low && low <= high && high <= MAX_ELEMENTS).then_some(low..=high)
}

fn unknown(item: &str, usual: &[Choice]) -> String {
    let mut possible: Vec<String> = Vec::new();
    for choice in usual {
        let suffix = if choice.is_bank() { "[:N or :A-B]" } else { "" };
        possible.push(format!("{}{suffix}", choice.family()));
    }
    possible.dedup();
    format!("no model {item:?}; there are all, {}", possible.join(", "))
}
