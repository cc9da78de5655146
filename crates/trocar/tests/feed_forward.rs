//! The table of feed-forward in the book is what its example prints.

#[allow(dead_code)]
#[path = "../examples/feed_forward.rs"]
mod example;

#[test]
fn the_page_has_the_table_of_the_example() {
    let page = include_str!("../../../docs/how-to/compensation.md");
    let table = example::table();
    assert!(page.contains(&table), "not in the page:\n{table}");
}
