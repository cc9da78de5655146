//! FNV-1a: distinguishes models and detects corrupted states. Not cryptographic.

const OFFSET_128: u128 = 0x6c62_272e_07bb_0142_62b8_2175_6295_c58d;
const PRIME_128: u128 = 0x0000_0000_0100_0000_0000_0000_0000_013b;
const OFFSET_64: u64 = 0xcbf2_9ce4_8422_2325;
const PRIME_64: u64 = 0x0000_0100_0000_01b3;

/// FNV-1a of 128 bits.
pub(crate) fn fnv_128(bytes: impl IntoIterator<Item = u8>) -> u128 {
    bytes
        .into_iter()
        .fold(OFFSET_128, |hash, byte| (hash ^ u128::from(byte)).wrapping_mul(PRIME_128))
}

/// FNV-1a of 64 bits.
pub(crate) fn fnv_64(bytes: &[u8]) -> u64 {
    bytes.iter().fold(OFFSET_64, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(PRIME_64))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Test vectors for the text "foobar" by the authors of the algorithm.
    #[test]
    fn published_vectors() {
        assert_eq!(fnv_64(b"foobar"), 0x85944171f73967e8);
        assert_eq!(fnv_128(*b"foobar"), 0x343e1662793c64bf6f0d3597ba446f18);
    }
}
