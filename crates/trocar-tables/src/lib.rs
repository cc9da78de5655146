//! Tables of named columns: what is in files, text, messages of ROS, results in every format that the readers
//! know, and files that are written whole or not at all.

pub mod content;
pub mod error;
pub mod line;
pub mod option;
pub mod output;
#[cfg(feature = "ros")]
pub mod ros;
pub mod table;
pub mod text;
