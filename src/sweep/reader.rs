//! Reading values of a sweep file: every mistake is noted with its place, and reading goes on.

use super::file::{Choice, Text};
use crate::graph::diagnostic::suggest;
use crate::graph::syntax::parse;
use crate::graph::tree::{Field, Shape, Value};
use crate::graph::{Code, Diagnostic, Source, Span};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Collects what is wrong.
pub struct Reader(Vec<Diagnostic>);

impl Reader {
    /// Nothing wrong yet.
    pub fn new() -> Self {
        Reader(Vec::new())
    }

    /// What was wrong.
    pub fn into_mistakes(self) -> Vec<Diagnostic> {
        self.0
    }

    /// Notes a mistake.
    pub fn report(&mut self, mistake: Diagnostic) {
        self.0.push(mistake);
    }

    /// Notes a mistake at `span`.
    pub fn mistake(&mut self, code: Code, span: &Span, message: impl Into<String>) {
        self.report(Diagnostic::new(code, span.clone(), message));
    }

    /// Notes a name that there is not, with the nearest of those there are.
    pub fn unknown<const N: usize>(
        &mut self,
        code: Code,
        span: &Span,
        message: String,
        wrong: &str,
        names: [&str; N],
    ) {
        let help = suggest(wrong, names, "there are");
        self.report(Diagnostic::new(code, span.clone(), message).help(help));
    }

    /// The fields of a file that is `Name(...)`, and its first word.
    pub fn root(&mut self, source: &Arc<Source>, name: &str) -> Option<(Span, Vec<Field>)> {
        let start = Span { source: Arc::clone(source), range: 0..0 };
        let parsed = parse(source, 0);
        self.0.extend(parsed.mistakes);
        match parsed.value?.shape {
            Shape::Fields(Some(head), fields) if head.text() == name => Some((head, fields)),
            Shape::Broken => None,
            _ => {
                self.mistake(Code::Field, &start, format!("expected `{name}(`"));
                None
            }
        }
    }

    /// The fields by name; those that are not among `known`, or come twice, are mistakes.
    pub fn known_fields(
        &mut self,
        of: &str,
        fields: Vec<Field>,
        known: &[&str],
    ) -> BTreeMap<String, Field> {
        let mut found: BTreeMap<String, Field> = BTreeMap::new();
        for field in fields {
            if !known.contains(&&*field.name) {
                let message = format!("`{of}` has no field `{}`", field.name);
                let help = suggest(&field.name, known.iter().copied(), "it has");
                self.report(Diagnostic::new(Code::Field, field.key.clone(), message).help(help));
            } else if let Some(first) = found.get(&field.name) {
                let message = format!("the field `{}` is given twice", field.name);
                let twice = Diagnostic::new(Code::Duplicate, field.key.clone(), message);
                self.report(twice.label("again").related(first.key.clone(), "first here"));
            } else {
                found.insert(field.name.clone(), field);
            }
        }
        found
    }

    /// The fields of `(a: 1, b: 2)`.
    pub fn fields(&mut self, value: Value) -> Option<Vec<Field>> {
        match value.shape {
            Shape::Fields(None, fields) => Some(fields),
            Shape::Broken => None,
            _ => {
                self.mistake(Code::Field, &value.span, "expected `(name: value, ...)`");
                None
            }
        }
    }

    /// The values of a list.
    pub fn list(&mut self, value: Value, expected: &str) -> Vec<Value> {
        match value.shape {
            Shape::List(values) => values,
            Shape::Broken => Vec::new(),
            _ => {
                self.mistake(Code::Shape, &value.span, format!("expected {expected}"));
                Vec::new()
            }
        }
    }

    /// A string, or a bare word.
    pub fn text(&mut self, value: &Value) -> Option<Text> {
        let text = match &value.shape {
            Shape::Text(text) => text.clone(),
            Shape::Word => value.span.text().to_owned(),
            Shape::Broken => return None,
            _ => {
                let found = value.span.text();
                self.mistake(
                    Code::Value,
                    &value.span,
                    format!("expected a string, found `{found}`"),
                );
                return None;
            }
        };
        Some(Text { text, span: value.span.clone() })
    }

    /// A list of strings, or one alone.
    pub fn texts(&mut self, value: &Value) -> Vec<Text> {
        match &value.shape {
            Shape::List(values) => values.iter().filter_map(|v| self.text(v)).collect(),
            _ => self.text(value).into_iter().collect(),
        }
    }

    /// `{ "name": value, ... }`.
    pub fn choices(&mut self, value: &Value) -> Vec<Choice> {
        let entries = self.entries(value);
        entries.iter().filter_map(|field| choice(field, &field.value)).collect()
    }

    /// `{ "name": [value, value], ... }`: one list of choices for each name.
    pub fn columns(&mut self, value: Value) -> Vec<Vec<Choice>> {
        let mut columns = Vec::new();
        for field in self.entries(&value) {
            let values = self.list(field.value.clone(), "a list of values");
            let column: Vec<Choice> = values.iter().filter_map(|v| choice(&field, v)).collect();
            if values.is_empty() {
                self.mistake(Code::Value, &field.key, format!("`{}` has no values", field.name));
            } else {
                columns.push(column);
            }
        }
        columns
    }

    fn entries(&mut self, value: &Value) -> Vec<Field> {
        match &value.shape {
            Shape::Map(fields) => fields.clone(),
            Shape::Broken => Vec::new(),
            _ => {
                self.mistake(Code::Shape, &value.span, "expected `{ \"name\": ... }`");
                Vec::new()
            }
        }
    }

    /// A number between two bounds.
    pub fn number(&mut self, value: &Value, least: f64, most: f64) -> Option<f64> {
        let text = value.span.text();
        let number = ron::from_str::<f64>(text).ok().filter(|n| (least..=most).contains(n));
        if number.is_none() {
            let message = format!("expected a number from {least} to {most}, found `{text}`");
            self.mistake(Code::Value, &value.span, message);
        }
        number
    }

    /// `true` or `false`; false after a mistake.
    pub fn truth(&mut self, value: &Value) -> bool {
        let text = value.span.text();
        if !["true", "false"].contains(&text) {
            let message = format!("expected `true` or `false`, found `{text}`");
            self.mistake(Code::Value, &value.span, message);
        }
        text == "true"
    }
}

fn choice(field: &Field, value: &Value) -> Option<Choice> {
    (!matches!(value.shape, Shape::Broken)).then(|| Choice {
        name: field.name.clone(),
        ron: value.ron(),
        key: field.key.clone(),
        value: value.span.clone(),
    })
}
