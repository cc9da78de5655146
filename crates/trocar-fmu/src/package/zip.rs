//! A ZIP archive (key ZIP in SOURCES.md) of uncompressed files, all dated 1980-01-01, so that the
//! same files give the same bytes.

use super::PackageError;

const VERSION: u16 = 20;
/// Created on Unix, so the permissions are Unix permissions.
const MADE_BY: u16 = 3 << 8 | VERSION;
/// 1980-01-01 in MS-DOS format.
const DATE: u16 = 1 << 5 | 1;
/// A regular file that everybody may read and execute: required for libraries and harmless for
/// other files.
const PERMISSIONS: u32 = 0o100_755 << 16;

/// An unfinished archive.
#[derive(Default)]
pub(super) struct Archive {
    bytes: Vec<u8>,
    directory: Vec<u8>,
    files: u16,
}

impl Archive {
    /// Adds a file under an ASCII name.
    pub(super) fn add(&mut self, name: &str, contents: &[u8]) -> Result<(), PackageError> {
        let offset = self.length()?;
        let size = u32::try_from(contents.len()).map_err(|_| PackageError::TooLarge)?;
        // Version needed, flags, method (stored), time, date.
        let mut common = Vec::new();
        [VERSION, 0, 0, 0, DATE].iter().for_each(|field| common.extend(field.to_le_bytes()));
        [crc_32(contents), size, size].iter().for_each(|field| common.extend(field.to_le_bytes()));
        // Lengths of the name and of the extra field.
        [name.len() as u16, 0].iter().for_each(|field| common.extend(field.to_le_bytes()));

        self.bytes.extend(b"PK\x03\x04");
        self.bytes.extend(&common);
        self.bytes.extend(name.as_bytes());
        self.bytes.extend(contents);

        self.directory.extend(b"PK\x01\x02");
        self.directory.extend(MADE_BY.to_le_bytes());
        self.directory.extend(&common);
        // Comment, disk, internal attributes.
        [0u16; 3].iter().for_each(|field| self.directory.extend(field.to_le_bytes()));
        [PERMISSIONS, offset].iter().for_each(|field| self.directory.extend(field.to_le_bytes()));
        self.directory.extend(name.as_bytes());
        self.files += 1;
        Ok(())
    }

    fn length(&self) -> Result<u32, PackageError> {
        u32::try_from(self.bytes.len()).map_err(|_| PackageError::TooLarge)
    }

    /// Completes the archive.
    pub(super) fn finish(mut self) -> Result<Vec<u8>, PackageError> {
        let offset = self.length()?;
        let size = self.directory.len() as u32;
        self.bytes.append(&mut self.directory);
        self.bytes.extend(b"PK\x05\x06");
        // Disks, and number of files on this one and in total.
        [0, 0, self.files, self.files]
            .iter()
            .for_each(|field| self.bytes.extend(field.to_le_bytes()));
        [size, offset].iter().for_each(|field| self.bytes.extend(field.to_le_bytes()));
        self.bytes.extend(0u16.to_le_bytes());
        Ok(self.bytes)
    }
}

/// CRC-32 of ISO 3309.
fn crc_32(bytes: &[u8]) -> u32 {
    const TABLE: [u32; 256] = {
        let mut table = [0; 256];
        let mut byte = 0;
        while byte < 256 {
            let (mut rest, mut bit) = (byte as u32, 0);
            while bit < 8 {
                rest = if rest & 1 == 1 { rest >> 1 ^ 0xedb8_8320 } else { rest >> 1 };
                bit += 1;
            }
            table[byte] = rest;
            byte += 1;
        }
        table
    };
    !bytes.iter().fold(!0, |crc: u32, byte| crc >> 8 ^ TABLE[usize::from(crc as u8 ^ byte)])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The check value published in catalogues of CRCs.
    #[test]
    fn check_value() {
        assert_eq!(crc_32(b"123456789"), 0xcbf4_3926);
    }
}
