//! Libraries that a program carries inside.

use crate::package::{Binary, PackageError, Platform};

/// What [`library::embed`](crate::library::embed) wrote when the program was built:
///
/// ```ignore
/// const INSIDE: trocar_fmu::Embedded = include!(concat!(env!("OUT_DIR"), "/fmu.rs"));
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Embedded {
    /// This crate as libraries: name of the platform in FMI 3.0, and the file.
    pub libraries: &'static [(&'static str, &'static [u8])],
    /// Why there is none; empty if there is one.
    pub reason: &'static str,
}

impl Embedded {
    /// Platforms of the libraries.
    ///
    /// # Errors
    /// [`PackageError::Refused`] for a name that FMI does not know.
    pub fn platforms(&self) -> Result<Vec<Platform>, PackageError> {
        self.libraries.iter().map(|(name, _)| name.parse()).collect()
    }

    /// Libraries for `platforms`, or all of them.
    ///
    /// # Errors
    /// [`PackageError::NotCarried`] without libraries, or without one of a platform.
    pub fn binaries(&self, platforms: Option<&[Platform]>) -> Result<Vec<Binary>, PackageError> {
        let carried = self.platforms()?;
        let wanted = platforms.unwrap_or(&carried);
        let missing = |platform: Option<Platform>| PackageError::NotCarried {
            platform,
            carried: carried.clone(),
            reason: self.reason,
        };
        if wanted.is_empty() {
            return Err(missing(None));
        }
        let binaries = wanted.iter().map(|platform| {
            let found = carried.iter().position(|other| other == platform);
            let found = found.ok_or_else(|| missing(Some(*platform)))?;
            Ok(Binary { platform: *platform, bytes: self.libraries[found].1.to_vec() })
        });
        binaries.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO: Embedded = Embedded {
        libraries: &[("x86_64-linux", b"\x7fELF"), ("x86_64-windows", b"MZ")],
        reason: "",
    };

    #[test]
    fn all_or_some_libraries_are_taken() {
        let names = |binaries: Vec<Binary>| -> Vec<String> {
            binaries.iter().map(|binary| binary.platform.to_string()).collect()
        };
        assert_eq!(names(TWO.binaries(None).unwrap()), ["x86_64-linux", "x86_64-windows"]);
        let windows = TWO.binaries(Some(&["win64".parse().unwrap()])).unwrap();
        assert_eq!(windows[0].bytes, b"MZ");
        assert_eq!(names(windows), ["x86_64-windows"]);
    }

    #[test]
    fn what_is_not_carried_is_refused_with_what_is() {
        let mac = "aarch64-darwin".parse().unwrap();
        let error = TWO.binaries(Some(&[mac])).unwrap_err().to_string();
        assert_eq!(
            error,
            "this build contains no FMU library for aarch64-darwin, only for x86_64-linux, x86_64-windows"
        );
        let none = Embedded { libraries: &[], reason: "no linker" };
        assert_eq!(
            none.binaries(None).unwrap_err().to_string(),
            "this build contains no FMU library: no linker"
        );
    }
}
