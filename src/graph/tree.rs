//! The tree of a RON text, in which everything knows its place.

use super::diagnostic::Span;

/// A value and its place.
#[derive(Clone, Debug)]
pub struct Value {
    /// All of it.
    pub span: Span,
    /// What it is made of.
    pub shape: Shape,
}

/// What a value is made of.
#[derive(Clone, Debug)]
pub enum Shape {
    /// A string.
    Text(String),
    /// An identifier alone: `true`, `None`, `max`.
    Word,
    /// A number.
    Number,
    /// `Name(a: 1)`, `(a: 1)`, or `()`.
    Fields(Option<Span>, Vec<Field>),
    /// `Name(1, 2)` or `(1, 2)`.
    Tuple(Option<Span>, Vec<Value>),
    /// `[1, 2]`.
    List(Vec<Value>),
    /// `{ "a": 1 }`.
    Map(Vec<Field>),
    /// Something that was reported already.
    Broken,
}

impl Value {
    /// The value as RON; strings in plain quotes, however they were written.
    pub fn ron(&self) -> String {
        match &self.shape {
            Shape::Text(text) => ron::to_string(text).unwrap_or_default(),
            _ => self.span.text().to_owned(),
        }
    }
}

/// A key and its value.
#[derive(Clone, Debug)]
pub struct Field {
    /// The key, without quotes.
    pub name: String,
    /// The key as written.
    pub key: Span,
    /// Whether the key stands in quotes.
    pub quoted: bool,
    /// What it stands for.
    pub value: Value,
}
