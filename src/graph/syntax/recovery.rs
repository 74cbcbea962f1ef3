//! Brackets that were forgotten or mixed up: where they were meant to close.

use super::entries::Entry;
use super::{GRAPH_FIELDS, Holds, Parser};
use crate::graph::tokens::Kind;

impl Parser<'_> {
    /// Whether the next token can only belong to an outer bracket.
    pub(super) fn belongs_outside(&self, holds: Holds, entries: &[Entry]) -> bool {
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
    pub(super) fn not_closed(&mut self, close: char) -> Option<()> {
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
}

#[cfg(test)]
mod tests {
    use super::super::tests::messages;

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
