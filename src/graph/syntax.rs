//! From tokens to a tree in which everything knows its place. The well-known slips (a forgotten comma or
//! bracket, `=` for `:`) are reported and read as meant, so that one pass finds all mistakes of a file.

use super::diagnostic::{Code, Diagnostic, Source, Span};
use super::tokens::{Kind, Token, tokens};
use super::tree::{Field, Shape, Value};
use std::ops::Range;
use std::sync::Arc;

/// The fields of `Graph`.
pub const GRAPH_FIELDS: [&str; 3] = ["vars", "nodes", "outputs"];
/// Brackets within brackets; graph files need five, and each level takes some of the stack.
const DEEPEST: usize = 64;

/// What came out of a text.
pub struct Parsed {
    /// The tree; none when there are mistakes after which nothing more can be said.
    pub value: Option<Value>,
    /// What was wrong.
    pub mistakes: Vec<Diagnostic>,
}

/// Reads one value that starts at byte `from`, and expects the text to end after it.
pub fn parse(source: &Arc<Source>, from: usize) -> Parsed {
    let lexed = tokens(source, from);
    if !lexed.usable {
        return Parsed { value: None, mistakes: lexed.mistakes };
    }
    let (tokens, mistakes) = (lexed.tokens, lexed.mistakes);
    let mut parser =
        Parser { source, tokens, next: 0, mistakes, open: Vec::new(), cut_short: false };
    let mut value = parser.value();
    if value.is_some() && *parser.peek(0) != Kind::End {
        let from = parser.tokens[parser.next].range.start;
        let message = format!("expected the end of the text, found {}", parser.found());
        parser.mistake(from..parser.tokens[parser.next].range.end, message);
        // After one word the rest may be anything; after brackets it tells that one was misplaced.
        value = value.filter(|v| matches!(v.shape, Shape::Word));
    }
    Parsed { value, mistakes: parser.mistakes }
}

/// What brackets hold.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Holds {
    Body,
    List,
    Map,
}

impl Holds {
    fn close(self) -> char {
        match self {
            Holds::Body => ')',
            Holds::List => ']',
            Holds::Map => '}',
        }
    }
}

struct Parser<'a> {
    source: &'a Arc<Source>,
    tokens: Vec<Token>,
    next: usize,
    mistakes: Vec<Diagnostic>,
    /// Brackets that are open here, the innermost last.
    open: Vec<(Holds, Range<usize>)>,
    /// Whether the last bracket was taken as closed before what belongs to an outer one.
    cut_short: bool,
}

/// One entry between brackets.
enum Entry {
    Keyed(Field),
    Bare(Value),
}

impl Parser<'_> {
    fn peek(&self, ahead: usize) -> &Kind {
        let last = self.tokens.len() - 1;
        &self.tokens[(self.next + ahead).min(last)].kind
    }

    fn take(&mut self) -> Range<usize> {
        let range = self.tokens[self.next].range.clone();
        self.next = (self.next + 1).min(self.tokens.len() - 1);
        range
    }

    fn span(&self, range: Range<usize>) -> Span {
        Span { source: Arc::clone(self.source), range }
    }

    fn mistake(&mut self, range: Range<usize>, message: impl Into<String>) -> &mut Diagnostic {
        let diagnostic = Diagnostic::new(Code::Syntax, self.span(range), message);
        self.mistakes.push(diagnostic);
        let last = self.mistakes.len() - 1;
        &mut self.mistakes[last]
    }

    fn found(&self) -> String {
        let token = &self.tokens[self.next];
        if token.kind == Kind::End {
            return "the end of the text".into();
        }
        format!("`{}`", &self.source.text[token.range.clone()])
    }

    /// End of the last token taken.
    fn behind(&self) -> usize {
        self.next.checked_sub(1).map_or(0, |i| self.tokens[i].range.end)
    }

    fn value(&mut self) -> Option<Value> {
        let start = self.tokens[self.next].range.start;
        let shape = match self.peek(0).clone() {
            Kind::Text(text) => {
                self.take();
                Shape::Text(text)
            }
            Kind::Number => {
                self.take();
                Shape::Number
            }
            Kind::Bad => {
                self.take();
                Shape::Broken
            }
            Kind::Word => {
                let range = self.take();
                let name = self.span(range);
                if *self.peek(0) == Kind::Open('(') { self.body(Some(name))? } else { Shape::Word }
            }
            Kind::Open('(') => self.body(None)?,
            Kind::Open('[') => {
                Shape::List(self.entries(Holds::List)?.into_iter().filter_map(bare).collect())
            }
            Kind::Open(_) => {
                Shape::Map(self.entries(Holds::Map)?.into_iter().filter_map(keyed).collect())
            }
            Kind::Comma | Kind::Close(_) | Kind::End => {
                let message = format!("expected a value, found {}", self.found());
                self.mistake(start..self.tokens[self.next].range.end, message);
                Shape::Broken
            }
            Kind::Colon | Kind::Equals => {
                let message = format!("expected a value, found {}", self.found());
                self.mistake(start..start + 1, message);
                return None;
            }
        };
        Some(Value { span: self.span(start..self.behind().max(start)), shape })
    }

    fn body(&mut self, name: Option<Span>) -> Option<Shape> {
        let entries = self.entries(Holds::Body)?;
        let tuple = entries.iter().any(|e| matches!(e, Entry::Bare(_)));
        Some(if tuple {
            Shape::Tuple(name, entries.into_iter().filter_map(bare).collect())
        } else {
            Shape::Fields(name, entries.into_iter().filter_map(keyed).collect())
        })
    }

    /// From an opening bracket to its closing one.
    fn entries(&mut self, holds: Holds) -> Option<Vec<Entry>> {
        let open = self.take();
        if self.open.len() == DEEPEST {
            self.mistake(open, format!("brackets are nested more than {DEEPEST} deep"));
            return None;
        }
        self.open.push((holds, open));
        let entries = self.until_closed(holds);
        self.open.pop();
        entries
    }

    fn until_closed(&mut self, holds: Holds) -> Option<Vec<Entry>> {
        let close = holds.close();
        let mut entries: Vec<Entry> = Vec::new();
        loop {
            match self.peek(0) {
                Kind::Close(c) if *c == close => {
                    self.take();
                    return Some(entries);
                }
                Kind::Close(_) | Kind::End => {
                    self.not_closed(close)?;
                    return Some(entries);
                }
                Kind::Comma => {
                    let range = self.take();
                    self.mistake(range, "a comma without anything before it").label =
                        "remove it".into();
                    continue;
                }
                _ if self.belongs_outside(holds, &entries) => {
                    self.not_closed(close)?;
                    return Some(entries);
                }
                _ => {}
            }
            let entry = self.entry(holds, &entries)?;
            entries.extend(entry);
            if std::mem::take(&mut self.cut_short) {
                continue;
            }
            match self.peek(0) {
                Kind::Comma => {
                    self.take();
                }
                Kind::Close(_) | Kind::End => {}
                Kind::Colon | Kind::Equals => {
                    let message = format!("expected `,` or `{close}`, found {}", self.found());
                    let range = self.tokens[self.next].range.clone();
                    self.mistake(range, message);
                    return None;
                }
                _ if self.belongs_outside(holds, &entries) => {}
                _ => {
                    let end = self.behind();
                    self.mistake(end..end, "a comma is missing").label = "add `,` here".into();
                }
            }
        }
    }

    /// Whether the next token can only belong to an outer bracket.
    fn belongs_outside(&self, holds: Holds, entries: &[Entry]) -> bool {
        let keyed = matches!(self.peek(1), Kind::Colon | Kind::Equals);
        let within = |outer| self.open.iter().rev().skip(1).any(|(h, _)| *h == outer);
        match (holds, self.peek(0)) {
            (Holds::Body, Kind::Text(_)) => {
                // `Frames("first": 0)` is a name in quotes by mistake, not a forgotten bracket.
                let quoted = entries
                    .first()
                    .is_none_or(|e| matches!(e, Entry::Keyed(field) if field.quoted));
                keyed && !quoted && within(Holds::Map)
            }
            (Holds::Body, Kind::Word) => {
                let tuple = matches!(entries.first(), Some(Entry::Bare(_)));
                keyed
                    && within(Holds::Body)
                    && (tuple || (within(Holds::Map) && self.graph_field()))
            }
            (Holds::List, Kind::Text(_)) => keyed && within(Holds::Map),
            (Holds::List, Kind::Word) => keyed && within(Holds::Body),
            (Holds::Map, Kind::Word) => keyed && within(Holds::Body) && self.graph_field(),
            _ => false,
        }
    }

    fn graph_field(&self) -> bool {
        GRAPH_FIELDS.contains(&&self.source.text[self.tokens[self.next].range.clone()])
    }

    /// Reports the innermost bracket as not closed, or as closed by another kind of bracket. At the end of
    /// the text, or at a bracket that closes nothing, there is no more to be said.
    fn not_closed(&mut self, close: char) -> Option<()> {
        let (_, open) = self.open.last()?.clone();
        let opens = self.source.text[open.clone()].to_owned();
        let opened = self.span(open);
        let mut outer = self.open.iter().rev().skip(1).map(|(holds, _)| holds.close());
        if let Kind::Close(c) = *self.peek(0) {
            let next_outer = outer.next();
            let goes_on = c == '}'
                && matches!(
                    (self.peek(1), self.peek(2), self.peek(3)),
                    (Kind::Comma, Kind::Text(_), Kind::Colon)
                );
            let mixed_up = if next_outer == Some(c) {
                goes_on
            } else {
                next_outer.is_some_and(|o| *self.peek(1) == Kind::Close(o))
            };
            let closes_outer = next_outer == Some(c) || outer.any(|o| o == c);
            if mixed_up || !closes_outer {
                let range = self.tokens[self.next].range.clone();
                let mistake = self.mistake(range, format!("expected `{close}`, found `{c}`"));
                mistake.related.push((opened, "to close this".into()));
                self.take();
                return mixed_up.then_some(());
            }
        }
        let fatal = *self.peek(0) == Kind::End;
        let end = self.behind();
        let mistake = self.mistake(end..end, format!("`{opens}` is not closed"));
        mistake.label = format!("add `{close}` here");
        mistake.related.push((opened, "opened here".into()));
        self.cut_short = true;
        (!fatal).then_some(())
    }

    /// One entry; none inside when it was reported and is best forgotten.
    fn entry(&mut self, holds: Holds, before: &[Entry]) -> Option<Option<Entry>> {
        let tuple = matches!(before.first(), Some(Entry::Bare(_)));
        let next_is_value = matches!(
            self.peek(1),
            Kind::Text(_) | Kind::Number | Kind::Word | Kind::Bad | Kind::Open('[' | '{')
        );
        let keyed = match (holds, self.peek(0), self.peek(1)) {
            (Holds::List, ..) => false,
            (_, Kind::Word | Kind::Text(_), Kind::Colon | Kind::Equals) => true,
            (Holds::Body, Kind::Word, _) => !tuple && next_is_value,
            (Holds::Map, Kind::Word | Kind::Text(_), Kind::Open('(')) => true,
            (Holds::Map, Kind::Word | Kind::Text(_), _) => next_is_value,
            _ => false,
        };
        if keyed {
            return self.field().map(|field| Some(Entry::Keyed(field)));
        }
        let value = self.value()?;
        let wants_key = holds == Holds::Map
            || (holds == Holds::Body && matches!(before.first(), Some(Entry::Keyed(_))));
        if !wants_key {
            return Some(Some(Entry::Bare(value)));
        }
        if !matches!(value.shape, Shape::Broken) {
            let form = if holds == Holds::Map { "\"name\": value" } else { "name: value" };
            self.mistake(value.span.range, format!("expected `{form}`"));
        }
        Some(None)
    }

    fn field(&mut self) -> Option<Field> {
        let (name, quoted) = match self.peek(0) {
            Kind::Text(text) => (text.clone(), true),
            _ => (self.source.text[self.tokens[self.next].range.clone()].to_owned(), false),
        };
        let range = self.take();
        let key = self.span(range);
        match self.peek(0) {
            Kind::Colon => {
                self.take();
            }
            Kind::Equals => {
                let range = self.take();
                self.mistake(range, "expected `:`, found `=`").label = "write `:`".into();
            }
            _ => {
                let end = self.behind();
                self.mistake(end..end, "expected `:` and a value after the name").label =
                    "add `:` here".into();
            }
        }
        Some(Field { name, key, quoted, value: self.value()? })
    }
}

fn bare(entry: Entry) -> Option<Value> {
    match entry {
        Entry::Bare(value) => Some(value),
        Entry::Keyed(_) => None,
    }
}

fn keyed(entry: Entry) -> Option<Field> {
    match entry {
        Entry::Keyed(field) => Some(field),
        Entry::Bare(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn go(text: &str) -> Parsed {
        parse(&Arc::new(Source { path: "t".into(), text: text.into() }), 0)
    }

    fn messages(text: &str) -> Vec<String> {
        go(text).mistakes.into_iter().map(|m| m.message).collect()
    }

    const FILE: &str = "#![enable(implicit_some)]\n// A\nGraph(vars: { \"s\": (6, 3), /* b */ \"t\": [1.5, \"x\"] },
        nodes: { \"a\": A(x: -1e3, y: \"b\", z: None), \"b\": B(), \"c\": C, \"d\": D(l: [\"a\", \"b\"], m: (1, 2)), },\n)";

    #[test]
    fn agrees_with_ron_on_what_is_right() {
        let mut texts = vec![FILE.to_owned()];
        for (i, c) in FILE.char_indices() {
            texts.push(FILE[..i].to_owned());
            texts.push(format!("{}{}", &FILE[..i], &FILE[i + c.len_utf8()..]));
        }
        texts.retain(|text| {
            let ours = go(text);
            let right = ours.value.is_some() && ours.mistakes.is_empty();
            right != ron::from_str::<ron::Value>(text).is_ok()
        });
        assert!(texts.is_empty(), "{} texts, such as:\n{}", texts.len(), texts.join("\n\n"));
    }

    #[test]
    fn nesting_has_an_end() {
        for bracket in ["(", "[", "{\"a\":", "A("] {
            let mistakes = messages(&bracket.repeat(10_000));
            assert!(mistakes.len() == 1 && mistakes[0].contains("64 deep"), "{mistakes:?}");
        }
        let deep = format!("{}1{}", "(".repeat(DEEPEST), ")".repeat(DEEPEST));
        assert!(messages(&deep).is_empty());
    }

    #[test]
    fn slips_are_told_once() {
        for (text, expected) in [
            ("A(x: 1 y: 2)", "a comma is missing"),
            ("A(x = 1)", "expected `:`, found `=`"),
            ("A(x 1)", "expected `:` and a value after the name"),
            ("A(x: 1,, y: 2)", "a comma without anything before it"),
            ("A(x: , y: 2)", "expected a value, found `,`"),
            ("A(x: 1, 2)", "expected `name: value`"),
            ("{ \"a\": 1, 2 }", "expected `\"name\": value`"),
            ("{ \"a\": A(x: 1, \"b\": 2 }", "`(` is not closed"),
            ("{ \"a\": A(x: (1, 2, y: 3), \"b\": 2 }", "`(` is not closed"),
            ("{ \"a\": [1, 2, \"b\": 2 }", "`[` is not closed"),
            ("G(vars: { \"a\": 1, nodes: { \"a\": A() })", "`{` is not closed"),
            ("G(vars: { \"a\": A(x: 1, nodes: { \"a\": A() })", "`(` is not closed"),
            ("{ \"a\": A(x: 1}, \"b\": 2 }", "expected `)`, found `}`"),
            ("A(x: [1}, y: 2)", "expected `]`, found `}`"),
            ("A(x: [1})", "expected `]`, found `}`"),
            ("[1)", "expected `]`, found `)`"),
            ("A(x: 1))", "expected the end of the text, found `)`"),
            ("[1: 2]", "expected `,` or `]`, found `:`"),
            ("[:]", "expected a value, found `:`"),
        ] {
            let mistakes = messages(text);
            assert_eq!(mistakes.first().map(String::as_str), Some(expected), "{text}");
        }
    }
}
