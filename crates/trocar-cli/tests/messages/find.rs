//! Texts in sources as a user reads them.

use proc_macro2::{TokenStream, TokenTree};
use syn::visit::{self, Visit};
use trocar::option::{Interface, spelt};

/// The texts of a source of Rust, without those of its tests.
pub(crate) fn of_rust(text: &str) -> Vec<String> {
    let file = syn::parse_file(text).expect("a source of Rust");
    let mut finder = Finder { found: Vec::new() };
    finder.visit_file(&file);
    finder.found
}

struct Finder {
    found: Vec<String>,
}

impl Finder {
    fn text(&mut self, text: &str) {
        self.found.push(spelt(&as_read(text), Interface::CommandLine));
    }

    fn tokens(&mut self, tokens: TokenStream) {
        let mut after_hash = false;
        for token in tokens {
            match token {
                TokenTree::Group(group) if after_hash && is_documentation(&group) => {}
                TokenTree::Group(group) => self.tokens(group.stream()),
                TokenTree::Literal(literal) => match syn::Lit::new(literal) {
                    syn::Lit::Str(text) => self.text(&text.value()),
                    syn::Lit::CStr(text) => self.text(&text.value().to_string_lossy()),
                    _ => {}
                },
                TokenTree::Punct(mark) => {
                    after_hash = mark.as_char() == '#';
                    continue;
                }
                TokenTree::Ident(_) => {}
            }
            after_hash = false;
        }
    }
}

/// A doc comment inside of a macro, which is an attribute there.
fn is_documentation(group: &proc_macro2::Group) -> bool {
    let first = group.stream().into_iter().next();
    matches!(first, Some(TokenTree::Ident(name)) if name == "doc")
}

fn is_test(attributes: &[syn::Attribute]) -> bool {
    let is_cfg_test = |attribute: &syn::Attribute| match &attribute.meta {
        syn::Meta::List(list) => list.path.is_ident("cfg") && list.tokens.to_string() == "test",
        _ => false,
    };
    attributes.iter().any(is_cfg_test)
}

impl<'ast> Visit<'ast> for Finder {
    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        if !is_test(&item.attrs) {
            visit::visit_item_mod(self, item);
        }
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        if !is_test(&item.attrs) {
            visit::visit_item_fn(self, item);
        }
    }

    fn visit_attribute(&mut self, attribute: &'ast syn::Attribute) {
        let syn::Meta::List(list) = &attribute.meta else { return };
        if list.path.is_ident("error") {
            // The format alone, not the texts in what is put in.
            let first = list.tokens.clone().into_iter().next();
            self.tokens(first.into_iter().collect());
        }
    }

    fn visit_macro(&mut self, item: &'ast syn::Macro) {
        self.tokens(item.tokens.clone());
    }

    fn visit_lit_str(&mut self, text: &'ast syn::LitStr) {
        self.text(&text.value());
    }

    fn visit_lit_cstr(&mut self, text: &'ast syn::LitCStr) {
        self.text(&text.value().to_string_lossy());
    }
}

/// The texts of a source of Python that stand on one line, without comments and documentation.
pub(crate) fn of_python(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut rest = text;
    while let Some(at) = rest.find(['#', '"', '\'']) {
        let from = &rest[at..];
        rest = match from.chars().next() {
            Some('#') => from.find('\n').map_or("", |end| &from[end..]),
            Some(quote) => {
                let long = quote.to_string().repeat(3);
                if let Some(inside) = from.strip_prefix(&long) {
                    inside.find(&long).map_or("", |end| &inside[end + 3..])
                } else {
                    let (inside, after) = one_line(&from[1..], quote);
                    found.push(as_read(&inside.replace("\\n", "\n")));
                    after
                }
            }
            None => "",
        };
    }
    found
}

/// A text up to its closing quote, and what follows. A backslash takes the next character with it.
fn one_line(text: &str, quote: char) -> (&str, &str) {
    let mut escaped = false;
    for (at, letter) in text.char_indices() {
        if letter == quote && !escaped {
            return (&text[..at], &text[at + 1..]);
        }
        escaped = letter == '\\' && !escaped;
    }
    (text, "")
}

/// A format as the page spells it: on one line, with `…` for what is put in.
fn as_read(text: &str) -> String {
    let mut read = String::new();
    let mut rest = text;
    while let Some(at) = rest.find(['{', '}']) {
        read += &rest[..at];
        let from = &rest[at..];
        rest = if from.starts_with("{{") || from.starts_with("}}") {
            read += &from[..1];
            &from[2..]
        } else if let Some(inside) = from.strip_prefix('{') {
            read.push('…');
            after_brace(inside)
        } else {
            &from[1..]
        };
    }
    read += rest;
    read.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// What follows the inside of a brace, which may hold further braces.
fn after_brace(text: &str) -> &str {
    let mut depth = 1;
    for (at, letter) in text.char_indices() {
        depth += i32::from(letter == '{') - i32::from(letter == '}');
        if depth == 0 {
            return &text[at + 1..];
        }
    }
    ""
}

#[test]
fn messages_are_found_wherever_they_stand_and_those_of_tests_are_not() {
    let source = r#"
        /// Not this one, it is documentation.
        enum E { #[error("{}: cannot open: {source}\n\nhint: look", path.display())] Open }
        fn f() {
            let x = if a { format!("{x:.3} N is too much") } else { "this is too little".to_owned() };
            console.warn(&format!("a {} b {}", "that one inside", name));
        }
        declared! {
            /// Nor this one, inside of a macro.
            name = "but this one is";
        }
        #[cfg(test)]
        mod tests { fn g() { h("this is a test") } }
    "#;
    assert_eq!(
        of_rust(source),
        [
            "…: cannot open: … hint: look",
            "… N is too much",
            "this is too little",
            "a … b …",
            "that one inside",
            "but this one is"
        ]
    );
    let source = "\"\"\"Not this, it is documentation.\"\"\"\nraise E(f\"{name!r} must be {', '.join(all)} here\")  # nor this one\n";
    assert_eq!(of_python(source), ["… must be … here"]);
}
