//! How many benches a statistic over random seals takes.

/// `few`; `many` with `./test --statistics`; as many as `TROCAR_STATISTICS` says where it is above 1.
pub(crate) fn benches(few: u64, many: u64) -> u64 {
    let Ok(text) = std::env::var("TROCAR_STATISTICS") else { return few };
    text.parse().ok().filter(|count| *count > 1).unwrap_or(many)
}
