//! From tokens to a tree in which everything knows its place. The well-known slips (a forgotten comma or
//! bracket, `=` for `:`) are reported and read as meant, so that one pass finds all mistakes of a file.

mod entries;
mod recovery;

use super::diagnostic::{Code, Diagnostic, Source, Span};
use super::tokens::{Kind, Token, tokens};
use super::tree::{Shape, Value};
use entries::{bare, keyed};
use std::ops::Range;
use std::sync::Arc;

/// The fields of `Graph`.
pub const GRAPH_FIELDS: [&str; 3] = ["vars", "nodes", "outputs"];

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
}

#[cfg(test)]
mod tests {
    use super::*;

    fn go(text: &str) -> Parsed {
        parse(&Arc::new(Source { path: "t".into(), text: text.into() }), 0)
    }

    pub(super) fn messages(text: &str) -> Vec<String> {
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
}
