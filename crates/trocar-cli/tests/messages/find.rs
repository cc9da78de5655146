//! Messages in sources: texts as a user reads them, with the names of what is put in.

use proc_macro2::{TokenStream, TokenTree};
use syn::visit::{self, Visit};
use trocar::option::{Interface, spelt};

/// Words that make a text a message, outside of `#[error]`.
const FEWEST_WORDS: usize = 3;

/// Calls, methods and macros whose texts no user reads, or reads as a name: of a stage, a column, a place.
const ELSEWHERE: [&str; 18] = [
    "expect",
    "assert",
    "assert_eq",
    "assert_ne",
    "debug_assert",
    "panic",
    "unreachable",
    "progress",
    "headed",
    "heading",
    "with_template",
    "thread_local",
    "create_exception",
    "macro_rules",
    "replace",
    "document",
    "prepare",
    "query_row",
];

/// The messages of a source of Rust. Of one that makes something else (not `whole`), only its errors.
pub(crate) fn of_rust(text: &str, whole: bool, names: &[&str]) -> Vec<String> {
    let file = syn::parse_file(text).expect("a source of Rust");
    let mut finder = Finder { found: Vec::new(), whole, names, is_error: false, silent: 0 };
    finder.visit_file(&file);
    finder.found
}

struct Finder<'n> {
    found: Vec<String>,
    whole: bool,
    names: &'n [&'n str],
    is_error: bool,
    /// How many enclosing calls and functions speak to nobody.
    silent: usize,
}

impl Finder<'_> {
    fn text(&mut self, text: &str) {
        let long =
            words(text) >= FEWEST_WORDS && self.whole && self.silent == 0 && !text.starts_with('<');
        if self.is_error || long {
            self.found.push(spelt(&as_read(text), Interface::CommandLine));
        }
    }

    fn tokens(&mut self, tokens: TokenStream) {
        let mut before = String::new();
        for token in tokens {
            match token {
                TokenTree::Group(group) if before == "#" && is_documentation(&group) => {}
                // A method inside of a macro speaks to nobody, too: `.expect("…")`.
                TokenTree::Group(group) => {
                    self.within(&before.clone(), |own| own.tokens(group.stream()))
                }
                TokenTree::Literal(literal) => match syn::Lit::new(literal) {
                    syn::Lit::Str(text) => self.text(&text.value()),
                    syn::Lit::CStr(text) => self.text(&text.value().to_string_lossy()),
                    _ => {}
                },
                TokenTree::Ident(name) => before = name.to_string(),
                // Between the name of a macro and what it holds.
                TokenTree::Punct(mark) if mark.as_char() == '!' => {}
                TokenTree::Punct(mark) if mark.as_char() == '#' => before = "#".to_owned(),
                TokenTree::Punct(_) => before.clear(),
            }
        }
    }

    fn within(&mut self, name: &str, inner: impl FnOnce(&mut Self)) {
        let silent = usize::from(ELSEWHERE.contains(&name));
        self.silent += silent;
        inner(self);
        self.silent -= silent;
    }

    fn function(&mut self, name: &syn::Ident, inner: impl FnOnce(&mut Self)) {
        let silent = usize::from(self.names.iter().any(|own| name == own));
        self.silent += silent;
        inner(self);
        self.silent -= silent;
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

impl<'ast> Visit<'ast> for Finder<'_> {
    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        if !is_test(&item.attrs) {
            visit::visit_item_mod(self, item);
        }
    }

    fn visit_item_fn(&mut self, item: &'ast syn::ItemFn) {
        if !is_test(&item.attrs) {
            self.function(&item.sig.ident, |own| visit::visit_item_fn(own, item));
        }
    }

    fn visit_impl_item_fn(&mut self, item: &'ast syn::ImplItemFn) {
        self.function(&item.sig.ident, |own| visit::visit_impl_item_fn(own, item));
    }

    fn visit_item_const(&mut self, item: &'ast syn::ItemConst) {
        self.function(&item.ident, |own| visit::visit_item_const(own, item));
    }

    fn visit_attribute(&mut self, attribute: &'ast syn::Attribute) {
        let syn::Meta::List(list) = &attribute.meta else { return };
        if list.path.is_ident("error") {
            self.is_error = true;
            // The format alone, not the texts in what is put in.
            let first = list.tokens.clone().into_iter().next();
            self.tokens(first.into_iter().collect());
            self.is_error = false;
        }
    }

    fn visit_macro(&mut self, item: &'ast syn::Macro) {
        let name = item.path.segments.last().map(|last| last.ident.to_string()).unwrap_or_default();
        self.within(&name, |own| own.tokens(item.tokens.clone()));
    }

    fn visit_expr_method_call(&mut self, call: &'ast syn::ExprMethodCall) {
        self.visit_expr(&call.receiver);
        self.within(&call.method.to_string(), |own| {
            call.args.iter().for_each(|one| own.visit_expr(one))
        });
    }

    fn visit_expr_call(&mut self, call: &'ast syn::ExprCall) {
        let name = match &*call.func {
            syn::Expr::Path(path) => path.path.segments.last().map(|last| last.ident.to_string()),
            _ => None,
        };
        self.within(&name.unwrap_or_default(), |own| visit::visit_expr_call(own, call));
    }

    fn visit_lit_str(&mut self, text: &'ast syn::LitStr) {
        self.text(&text.value());
    }

    fn visit_lit_cstr(&mut self, text: &'ast syn::LitCStr) {
        self.text(&text.value().to_string_lossy());
    }
}

/// The messages of a source of Python: its texts on one line, without comments, documentation and markup. Of one that makes something
/// else (not `whole`), only what it raises.
pub(crate) fn of_python(text: &str, whole: bool) -> Vec<String> {
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
                    let message = inside.replace("\\n", "\n");
                    let is_markup = message.starts_with('<');
                    let counts = whole || is_raised(&text[..text.len() - from.len()]);
                    if counts && words(&message) >= FEWEST_WORDS && !is_markup {
                        found.push(as_read(&message));
                    }
                    after
                }
            }
            None => "",
        };
    }
    found
}

/// What begins a statement of a script whose texts a user reads: of any length, and of three words or more.
const THROWN: [&str; 2] = ["Error(", "console.error("];
const SHOWN: [&str; 3] = ["message.textContent", "return ", "words ="];

/// The messages of a script of a page: texts that `+` joins are one, with `…` for what is put in between.
pub(crate) fn of_javascript(text: &str) -> Vec<String> {
    // With whether they are thrown.
    let mut found: Vec<(String, bool)> = Vec::new();
    // Where the statement began, and where its last text ended.
    let (mut begin, mut at, mut last) = (0, 0, None);
    while let Some(next) = text[at..].find(['"', ';', '{', '}', '/']) {
        let from = at + next;
        at = from + 1;
        match &text[from..at] {
            "\"" => {
                let (inside, after) = one_line(&text[at..], '"');
                at = text.len() - after.len();
                let has =
                    |marks: &[&str]| marks.iter().any(|mark| text[begin..from].contains(mark));
                let goes_on = last.is_some_and(|end: usize| is_sum(&text[end..from]));
                match found.last_mut().filter(|_| goes_on) {
                    Some((message, _)) => message.push_str(inside),
                    None if has(&THROWN) => found.push((inside.to_owned(), true)),
                    None if has(&SHOWN) => found.push((inside.to_owned(), false)),
                    None => continue,
                }
                let is_followed = is_followed(after);
                if let Some((message, _)) = found.last_mut().filter(|_| is_followed) {
                    message.push_str("{…}");
                }
                last = Some(at);
            }
            "/" if text[at..].starts_with('/') => {
                at = text[at..].find('\n').map_or(text.len(), |end| at + end);
            }
            "/" => {}
            _ => (begin, last) = (at, None),
        }
    }
    found.retain(|(message, thrown)| *thrown || words(message) >= FEWEST_WORDS);
    found.iter().map(|(message, _)| as_read(message)).collect()
}

/// Whether a text goes on with `+` and something that is no text.
fn is_followed(after: &str) -> bool {
    after.trim_start().strip_prefix('+').is_some_and(|rest| !rest.trim_start().starts_with('"'))
}

/// Whether code between two texts joins them by `+`.
fn is_sum(code: &str) -> bool {
    let code = code.trim();
    code.starts_with('+') && code.ends_with('+') && !code.contains(['?', ':'])
}

/// Whether what follows `before` is inside the parentheses of a `raise`.
fn is_raised(before: &str) -> bool {
    let Some(at) = before.rfind("raise ") else { return false };
    let mut depth = 0;
    for letter in before[at..].chars() {
        depth += i32::from(letter == '(') - i32::from(letter == ')');
        if letter == ')' && depth == 0 {
            return false;
        }
    }
    depth > 0
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

/// Words of two letters or more, without those of what is put in.
fn words(text: &str) -> usize {
    let text = as_read(text);
    let outside = text.split('{').map(|part| part.rsplit('}').next().unwrap_or_default());
    let is_word = |word: &&str| word.chars().filter(|letter| letter.is_alphabetic()).count() >= 2;
    outside.flat_map(str::split_whitespace).filter(is_word).count()
}

/// A format as its reader knows it: on one line, with the plain names of what is put in, `…` for the rest.
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
            let (inside, after) = put_in(inside);
            let name = inside.split([':', '!']).next().unwrap_or_default();
            let is_name = !name.is_empty()
                && name.chars().all(|letter| letter.is_alphanumeric() || letter == '_')
                && !name.starts_with(|letter: char| letter.is_ascii_digit());
            read += &format!("{{{}}}", if is_name { name } else { "…" });
            after
        } else {
            &from[1..]
        };
    }
    read += rest;
    read.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// What stands inside a brace, which may hold further braces, and what follows it.
fn put_in(text: &str) -> (&str, &str) {
    let mut depth = 1;
    for (at, letter) in text.char_indices() {
        depth += i32::from(letter == '{') - i32::from(letter == '}');
        if depth == 0 {
            return (&text[..at], &text[at + 1..]);
        }
    }
    (text, "")
}

#[test]
fn messages_are_found_wherever_they_stand_and_texts_for_nobody_are_not() {
    let source = r#"
        /// Not this one, it is documentation.
        enum E { #[error("{}: cannot open: {source}\n\nhint: look", path.display())] Open }
        fn f() {
            let x = if a { format!("{x:.3} N is too much") } else { "this is too little".to_owned() };
            console.warn(&format!("a {} b {}", "that one inside", name.expect("never seen by users")));
            assert!(x, "neither is this one");
        }
        declared! {
            /// Nor this one, inside of a macro.
            name = "but this one is";
        }
        #[cfg(test)]
        mod tests { fn g() { h("this is a test") } }
    "#;
    assert_eq!(
        of_rust(source, true, &[]),
        [
            "{…}: cannot open: {source} hint: look",
            "{x} N is too much",
            "this is too little",
            "that one inside",
            "but this one is"
        ]
    );
    let source = "\"\"\"Not this, it is documentation.\"\"\"\nraise E(f\"{name!r} must be {', '.join(all)} here\")  # nor this one\n";
    assert_eq!(of_python(source, true), ["{name} must be {…} here"]);
    let source = "title = \"one of three words\"\nraise E(\"this is an error\")\ntext(\"two and a half words\")\n";
    assert_eq!(of_python(source, false), ["this is an error"]);
}

#[test]
fn messages_of_scripts_are_what_is_thrown_or_shown() {
    let source = r#"
        // throw new Error("not this one, it is a comment");
        if (!ok) throw new Error("no model");
        start().catch((error) => console.error("live model: " + error.message));
        this.message.textContent = works ? "" : "No such model; the last one stays.";
        const words = slow ? "ended after " + end.toFixed(1) + " s of work" : "all is well here";
        button(bar, "Reset all", "Reset all of the parameters", () => this.reset());
    "#;
    assert_eq!(
        of_javascript(source),
        [
            "no model",
            "live model: {…}",
            "No such model; the last one stays.",
            "ended after {…} s of work",
            "all is well here"
        ]
    );
}
