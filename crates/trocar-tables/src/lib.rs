//! Files of results: tables of named columns in every format that the readers know, and files that
//! are written whole or not at all.

pub mod error;
pub mod line;
pub mod option;
pub mod output;
pub mod table;
