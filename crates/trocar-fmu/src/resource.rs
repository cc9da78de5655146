//! The model inside an FMU: `resources/model.f64`, the row of [`Trocar::write_numbers`] in
//! little-endian bytes.

use std::fs;
use std::path::{Path, PathBuf};

use trocar_model::Trocar;

use crate::error::FmuError;

/// File name of the model in the resources.
pub(crate) const MODEL: &str = "model.f64";

/// A model as read from its file.
#[derive(Debug, Clone)]
pub(crate) struct Resource {
    pub(crate) row: Vec<f64>,
    pub(crate) trocar: Trocar<Vec<f64>>,
}

/// The row of `trocar` as bytes.
pub(crate) fn to_bytes(row: &[f64]) -> Vec<u8> {
    row.iter().flat_map(|number| number.to_le_bytes()).collect()
}

/// The row of `trocar`.
pub(crate) fn to_row<K: AsRef<[f64]>>(trocar: &Trocar<K>) -> Vec<f64> {
    let mut row = vec![0.0; trocar.count_numbers()];
    trocar.write_numbers(&mut row).expect("the row has the length that was asked for");
    row
}

impl Resource {
    /// Reads the model from the folder of resources.
    pub(crate) fn read(folder: &Path) -> Result<Self, FmuError> {
        let path = folder.join(MODEL);
        let shown = path.display().to_string();
        match fs::read(&path) {
            Ok(bytes) => Self::from_bytes(&bytes, &shown),
            Err(error) => Err(FmuError::refused(format!("cannot read the model {shown}: {error}"))),
        }
    }

    /// The model from the bytes of the file `path`.
    pub(crate) fn from_bytes(bytes: &[u8], path: &str) -> Result<Self, FmuError> {
        let damaged =
            |why: String| FmuError::refused(format!("the model {path} is damaged: {why}"));
        let (numbers, rest) = bytes.as_chunks::<8>();
        let row: Vec<f64> = numbers.iter().map(|number| f64::from_le_bytes(*number)).collect();
        let trocar = Trocar::from_numbers(&row).map_err(|error| damaged(error.to_string()))?;
        if !rest.is_empty() || trocar.count_numbers() != row.len() {
            return Err(damaged(format!("{} bytes are not one whole model", bytes.len())));
        }
        let trocar = trocar.stored_as(<[f64]>::to_vec);
        Ok(Self { row, trocar })
    }
}

/// The folder behind a resource location of FMI 2.0, a `file:` URI (RFC 8089).
pub(crate) fn folder_of_uri(uri: &str) -> Result<PathBuf, FmuError> {
    let wrong =
        || FmuError::refused(format!("resource location must be a file: URI, got \"{uri}\""));
    let scheme =
        uri.get(..5).filter(|scheme| scheme.eq_ignore_ascii_case("file:")).ok_or_else(wrong)?;
    let rest = &uri[scheme.len()..];
    let path = match rest.strip_prefix("//") {
        None => rest,
        Some(after) => {
            let slash = after.find('/').ok_or_else(wrong)?;
            let (host, path) = after.split_at(slash);
            if !(host.is_empty() || host.eq_ignore_ascii_case("localhost")) {
                return Err(wrong());
            }
            path
        }
    };
    let path = percent_decoded(path).filter(|path| path.starts_with('/')).ok_or_else(wrong)?;
    // "/C:/folder" is "C:/folder" on Windows.
    let drive = cfg!(windows) && path.as_bytes().get(2) == Some(&b':');
    Ok(PathBuf::from(if drive { &path[1..] } else { &path }))
}

/// `None` if the text is not valid percent-encoded UTF-8.
fn percent_decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let [first, after @ ..] = rest {
        rest = after;
        if *first != b'%' {
            bytes.push(*first);
            continue;
        }
        let hex = after.get(..2).filter(|hex| hex.iter().all(u8::is_ascii_hexdigit))?;
        bytes.push(u8::from_str_radix(std::str::from_utf8(hex).ok()?, 16).ok()?);
        rest = &after[2..];
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use trocar_model::{Element, ElementParams, PositionProfile};

    use super::*;

    #[test]
    fn file_uris() {
        for (uri, path) in [
            ("file:///tmp/a/resources", "/tmp/a/resources"),
            ("file:/tmp/a", "/tmp/a"),
            ("FILE://localhost/tmp/a%20b/%C3%A4%25", "/tmp/a b/ä%"),
            ("file:///tmp/ä b/", "/tmp/ä b/"),
        ] {
            assert_eq!(folder_of_uri(uri).unwrap(), PathBuf::from(path), "{uri}");
        }
        for uri in [
            "",
            "/tmp/a",
            "http://host/a",
            "file://elsewhere/a",
            "file:a",
            "file:///a%2",
            "file:///%ff",
            "file://",
        ] {
            let refused = folder_of_uri(uri).expect_err("no file URI").to_string();
            let expected = format!("resource location must be a file: URI, got \"{uri}\"");
            assert_eq!(refused, expected);
        }
    }

    fn rows() -> [Vec<f64>; 2] {
        let element = Element::new(ElementParams::plausible_10_5_mm().unwrap()).unwrap();
        let profile = PositionProfile::new(0.0, 0.2, [0.1, 0.2, 0.0], [1.0, 1.1, 0.9]).unwrap();
        [to_row(&Trocar::of_seal(element)), to_row(&Trocar::new(element, Some(profile)))]
    }

    #[test]
    fn every_truncation_is_refused() {
        for row in rows() {
            let bytes = to_bytes(&row);
            let read = Resource::from_bytes(&bytes, "").unwrap();
            assert!(read.row == row && to_row(&read.trocar) == row);
            for length in 0..bytes.len() {
                assert!(Resource::from_bytes(&bytes[..length], "m").is_err(), "{length} bytes");
            }
            assert!(Resource::from_bytes(&[&bytes[..], &[0; 8]].concat(), "m").is_err());
        }
    }
}
