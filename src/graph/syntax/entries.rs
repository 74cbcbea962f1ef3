//! What stands between brackets: values, or names with values.

use super::{Holds, Parser};
use crate::graph::diagnostic::Span;
use crate::graph::tokens::Kind;
use crate::graph::tree::{Field, Shape, Value};

/// Brackets within brackets; graph files need five, and each level takes some of the stack.
const DEEPEST: usize = 64;

/// One entry between brackets.
pub(super) enum Entry {
    Keyed(Field),
    Bare(Value),
}

impl Parser<'_> {
    pub(super) fn body(&mut self, name: Option<Span>) -> Option<Shape> {
        let entries = self.entries(Holds::Body)?;
        let tuple = entries.iter().any(|e| matches!(e, Entry::Bare(_)));
        Some(if tuple {
            Shape::Tuple(name, entries.into_iter().filter_map(bare).collect())
        } else {
            Shape::Fields(name, entries.into_iter().filter_map(keyed).collect())
        })
    }

    /// From an opening bracket to its closing one.
    pub(super) fn entries(&mut self, holds: Holds) -> Option<Vec<Entry>> {
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

pub(super) fn bare(entry: Entry) -> Option<Value> {
    match entry {
        Entry::Bare(value) => Some(value),
        Entry::Keyed(_) => None,
    }
}

pub(super) fn keyed(entry: Entry) -> Option<Field> {
    match entry {
        Entry::Keyed(field) => Some(field),
        Entry::Bare(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::messages;
    use super::*;

    #[test]
    fn nesting_has_an_end() {
        for bracket in ["(", "[", "{\"a\":", "A("] {
            let mistakes = messages(&bracket.repeat(10_000));
            assert!(mistakes.len() == 1 && mistakes[0].contains("64 deep"), "{mistakes:?}");
        }
        let deep = format!("{}1{}", "(".repeat(DEEPEST), ")".repeat(DEEPEST));
        assert!(messages(&deep).is_empty());
    }
}
