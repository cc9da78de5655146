//! Text that holds tables: its compression and encoding, separators, numbers and dates.

mod format;
mod input;
mod split;
pub mod timestamp;
mod utf16;

pub use format::{Format, Marks, Separator, comment_text, is_comment};
pub use input::{Head, TextInput};
pub use split::{Splitter, text_of};
