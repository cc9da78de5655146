//! Gives the shared library the name that programs linked with it look for.

use std::env;

/// Number behind the name; raised with `ABI_VERSION` (a test compares them).
const SONAME_VERSION: u32 = 5;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    match env::var("CARGO_CFG_TARGET_OS").as_deref() {
        Ok("linux") => {
            println!("cargo:rustc-cdylib-link-arg=-Wl,-soname,libtrocar_c.so.{SONAME_VERSION}")
        }
        Ok("macos") => {
            println!(
                "cargo:rustc-cdylib-link-arg=-Wl,-install_name,@rpath/libtrocar_c.{SONAME_VERSION}.dylib"
            )
        }
        _ => {}
    }
}
