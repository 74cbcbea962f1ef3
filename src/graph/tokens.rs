//! From text to tokens: words, strings and marks of RON, each with its place.

use super::diagnostic::{Code, Diagnostic, Source, Span};
use std::ops::Range;
use std::sync::Arc;

/// A token's kind.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A string, unescaped.
    Text(String),
    /// An identifier.
    Word,
    /// A number.
    Number,
    /// `(`, `[` or `{`.
    Open(char),
    /// `)`, `]` or `}`.
    Close(char),
    /// `,`
    Comma,
    /// `:`
    Colon,
    /// `=`
    Equals,
    /// Stands where a value was meant; already reported.
    Bad,
    /// The end of the text.
    End,
}

/// A piece of the text that means something.
#[derive(Clone, Debug)]
pub struct Token {
    /// What it is.
    pub kind: Kind,
    /// Its bytes.
    pub range: Range<usize>,
}

/// What came out of a text.
pub struct Tokens {
    /// Everything but white space, comments and attributes; the last is [`Kind::End`].
    pub tokens: Vec<Token>,
    /// What was wrong.
    pub mistakes: Vec<Diagnostic>,
    /// Whether the tokens after a mistake can be trusted.
    pub usable: bool,
}

struct Lexer<'a> {
    source: &'a Arc<Source>,
    at: usize,
    out: Tokens,
}

/// Cuts a text into tokens from byte `from` on.
pub fn tokens(source: &Arc<Source>, from: usize) -> Tokens {
    let out = Tokens { tokens: Vec::new(), mistakes: Vec::new(), usable: true };
    let mut lexer = Lexer { source, at: from, out };
    while let Some(c) = lexer.rest().chars().next() {
        lexer.token(c);
    }
    let end = source.text.len();
    lexer.out.tokens.push(Token { kind: Kind::End, range: end..end });
    lexer.out
}

impl<'a> Lexer<'a> {
    fn rest(&self) -> &'a str {
        &self.source.text[self.at..]
    }

    fn token(&mut self, first: char) {
        let rest = self.rest();
        match first {
            c if c.is_whitespace() || (c == '\u{feff}' && self.at == 0) => self.at += c.len_utf8(),
            '/' if rest.starts_with("//") => self.at += rest.find('\n').unwrap_or(rest.len()),
            '/' if rest.starts_with("/*") => self.block_comment(),
            '#' if rest.starts_with("#![") && self.out.tokens.is_empty() => self.attribute(),
            '"' => self.text(),
            'r' if rest[1..].trim_start_matches('#').starts_with('"') => self.raw_text(),
            '\'' => {
                let line = rest.find('\n').unwrap_or(rest.len());
                let len = rest[1..line].find('\'').map_or(line, |i| i + 2);
                self.bad(len, "text stands in double quotes", rest[1..len].trim_end_matches('\''));
            }
            '$' => {
                let len = 1 + run(&rest[1..], |c| c.is_alphanumeric() || c == '_');
                self.bad(len, "a variable stands in quotes", &rest[..len]);
            }
            '(' | '[' | '{' => self.push(Kind::Open(first), 1),
            ')' | ']' | '}' => self.push(Kind::Close(first), 1),
            ',' => self.push(Kind::Comma, 1),
            ':' => self.push(Kind::Colon, 1),
            '=' => self.push(Kind::Equals, 1),
            c if c.is_alphabetic() || c == '_' => {
                self.push(Kind::Word, run(rest, |c| c.is_alphanumeric() || c == '_'));
            }
            c if c.is_ascii_digit() || "+-.".contains(c) => self.number(),
            c => {
                let len = run(rest, |other| other == c);
                self.fatal(self.at..self.at + len, format!("unexpected `{}`", &rest[..len]));
                self.at += len;
            }
        }
    }

    fn push(&mut self, kind: Kind, len: usize) {
        self.out.tokens.push(Token { kind, range: self.at..self.at + len });
        self.at += len;
    }

    fn mistake(&mut self, range: Range<usize>, message: impl Into<String>) -> &mut Diagnostic {
        let span = Span { source: Arc::clone(self.source), range };
        self.out.mistakes.push(Diagnostic::new(Code::Syntax, span, message));
        let last = self.out.mistakes.len() - 1;
        &mut self.out.mistakes[last]
    }

    fn fatal(&mut self, range: Range<usize>, message: impl Into<String>) -> &mut Diagnostic {
        self.out.usable = false;
        self.mistake(range, message)
    }

    /// A value written in a way that is understood but not allowed.
    fn bad(&mut self, len: usize, message: &str, meant: &str) {
        let help = format!("write \"{meant}\"");
        self.mistake(self.at..self.at + len, message).help = Some(help);
        self.push(Kind::Bad, len);
    }

    fn number(&mut self) {
        let rest = self.rest();
        let len = run(rest, |c| c.is_alphanumeric() || "_.+-".contains(c));
        if matches!(ron::from_str(&rest[..len]), Ok(ron::Value::Number(_))) {
            self.push(Kind::Number, len);
        } else {
            let text = &rest[..len];
            self.mistake(self.at..self.at + len, format!("`{text}` is not a number"));
            self.push(Kind::Bad, len);
        }
    }

    /// RON lets a string go over lines; names and paths do not, and so a forgotten quote is found where it is.
    fn text(&mut self) {
        let rest = self.rest();
        let mut escaped = false;
        for (i, c) in rest.char_indices().skip(1) {
            match c {
                '\n' => break,
                _ if escaped => escaped = false,
                '\\' => escaped = true,
                '"' => {
                    return match ron::from_str::<String>(&rest[..=i]) {
                        Ok(text) => self.push(Kind::Text(text), i + 1),
                        Err(error) => {
                            let what = format!("this string cannot be read: {}", error.code);
                            self.mistake(self.at..self.at + i + 1, what);
                            self.push(Kind::Bad, i + 1);
                        }
                    };
                }
                _ => {}
            }
        }
        self.odd_quote(rest.lines().next().unwrap_or_default().trim_end().len().max(1));
    }

    /// A line with a quote too few. The quote is rather missing in the first string that goes on into
    /// what looks like other fields; whatever else the line seems to say is not to be trusted.
    fn odd_quote(&mut self, len: usize) {
        let end = self.at + len;
        let line = self.source.text[..self.at].rfind('\n').map_or(0, |i| i + 1);
        self.out.mistakes.retain(|m| m.span.range.start < line);
        let here = self.out.tokens.iter().filter(|t| t.range.start >= line);
        let suspect = here
            .into_iter()
            .find(|t| matches!(&t.kind, Kind::Text(text) if text.contains([':', '('])));
        let start = suspect.map_or(self.at, |t| t.range.start);
        self.fatal(start..start + 1, "this string is not closed").label =
            "a `\"` on this line has no partner".into();
        self.at = end;
    }

    fn raw_text(&mut self) {
        let rest = self.rest();
        let hashes = run(&rest[1..], |c| c == '#');
        let end = format!("\"{}", "#".repeat(hashes));
        let start = hashes + 2;
        let Some(len) = rest[start..].find(&end) else {
            self.fatal(self.at..self.at + start, "this string is not closed").help =
                Some(format!("it ends with `{end}`"));
            self.at = self.source.text.len();
            return;
        };
        self.push(Kind::Text(rest[start..start + len].to_owned()), start + len + end.len());
    }

    fn block_comment(&mut self) {
        let rest = self.rest();
        let mut depth = 0usize;
        let mut i = 0;
        while let Some(found) = rest[i..].find(['/', '*']) {
            i += found;
            match rest.as_bytes().get(i..i + 2) {
                Some(b"/*") => depth += 1,
                Some(b"*/") => depth -= 1,
                _ => {
                    i += 1;
                    continue;
                }
            }
            i += 2;
            if depth == 0 {
                self.at += i;
                return;
            }
        }
        self.fatal(self.at..self.at + 2, "this comment is not closed").help =
            Some("it ends with `*/`".into());
        self.at = self.source.text.len();
    }

    fn attribute(&mut self) {
        let rest = self.rest();
        let Some(len) = rest.lines().next().and_then(|line| line.find(']')) else {
            self.fatal(self.at..self.at + 3, "this attribute is not closed").help =
                Some("it ends with `]`".into());
            self.at = self.source.text.len();
            return;
        };
        let inside: String = rest[3..len].split_whitespace().collect();
        let enabled = inside.strip_prefix("enable(").and_then(|t| t.strip_suffix(')'));
        let implicit_some =
            |names: &str| names.split(',').all(|n| n.is_empty() || n == "implicit_some");
        // The other two are for editors.
        let known = enabled.is_some_and(implicit_some)
            || inside.starts_with("type=")
            || inside.starts_with("schema=");
        if !known {
            self.mistake(self.at..self.at + len + 1, "graph files do not know this attribute")
                .help = Some("`#![enable(implicit_some)]` is the one they know".into());
        }
        self.at += len + 1;
    }
}

/// Bytes of the longest beginning of `text` made of such characters.
fn run(text: &str, belongs: impl Fn(char) -> bool) -> usize {
    text.find(|c| !belongs(c)).unwrap_or(text.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cut(text: &str) -> (Vec<Kind>, Vec<String>) {
        let source = Arc::new(Source { path: "t".into(), text: text.into() });
        let out = tokens(&source, 0);
        (
            out.tokens.into_iter().map(|t| t.kind).collect(),
            out.mistakes.into_iter().map(|m| m.message).collect(),
        )
    }

    #[test]
    fn knows_every_kind() {
        let (kinds, mistakes) = cut(
            "#![enable(implicit_some)] A(/* /* x */ */ b: -1e3, r#\"q\"c\"#: \"\\u{e9}\") // end",
        );
        let text = |t: &str| Kind::Text(t.into());
        use Kind::{Close, Colon, Comma, End, Number, Open, Word};
        assert_eq!(
            kinds,
            [
                Word,
                Open('('),
                Word,
                Colon,
                Number,
                Comma,
                text("q\"c"),
                Colon,
                text("é"),
                Close(')'),
                End
            ]
        );
        assert!(mistakes.is_empty(), "{mistakes:?}");
    }

    #[test]
    fn tells_what_is_wrong() {
        for (text, message) in [
            ("\"abc\n", "not closed"),
            ("r#\"abc\"", "not closed"),
            ("/* /* */", "not closed"),
            ("#![enable(x", "not closed"),
            ("#![enable(unwrap_newtypes)]", "do not know"),
            ("#![enable(implicit_some]", "do not know"),
            ("'abc'", "double quotes"),
            ("'abc", "double quotes"),
            ("$size", "variable stands in quotes"),
            ("12x", "`12x` is not a number"),
            ("\"\\q\"", "cannot be read"),
            ("@@", "unexpected `@@`"),
        ] {
            let mistakes = cut(text).1;
            assert!(mistakes.len() == 1 && mistakes[0].contains(message), "{text}: {mistakes:?}");
        }
    }
}
