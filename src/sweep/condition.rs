//! Conditions over the variables of a point, in the Common Expression Language:
//! `columns > 4 * rows[0] * rows[1]`.

use super::file::Text;
use crate::graph::diagnostic::suggest;
use crate::graph::{Code, Diagnostic};
use cel::{Context, ExecutionError, Program, Value};
use std::collections::BTreeMap;

/// A condition that was understood.
pub struct Condition {
    text: Text,
    program: Program,
}

impl Condition {
    /// Understands `text`, which may speak of `names`; a dot or a dash in a name is written `_`.
    ///
    /// # Errors
    /// What is wrong with it, and where.
    pub fn new(text: &Text, names: &BTreeMap<String, String>) -> Result<Self, Box<Diagnostic>> {
        let wrong = |message| Diagnostic::new(Code::Value, text.span.clone(), message);
        let program = Program::compile(&text.text).map_err(|problem| {
            let problem = problem.to_string();
            let reason = problem.lines().next().unwrap_or_default().trim_start_matches("ERROR: ");
            wrong(format!("not a condition: {reason}"))
        })?;
        let identifiers: Vec<String> = names.keys().map(|name| identifier(name)).collect();
        for name in program.references().variables() {
            if !identifiers.iter().any(|known| known == name) {
                let help = suggest(name, identifiers.iter().map(|n| &**n), "there are");
                return Err(Box::new(wrong(format!("there is no variable `{name}`")).help(help)));
            }
        }
        Ok(Condition { text: text.clone(), program })
    }

    /// Whether it holds where names have these values, as RON text.
    ///
    /// # Errors
    /// When it gives no truth value.
    pub fn holds(&self, values: &BTreeMap<String, String>) -> Result<bool, Box<Diagnostic>> {
        let mut context = Context::default();
        for (name, ron) in values {
            context.add_variable_from_value(identifier(name), value(ron));
        }
        let message = match self.program.execute(&context) {
            Ok(Value::Bool(holds)) => return Ok(holds),
            Ok(other) => format!("expected a truth value, found {other:?}"),
            Err(ExecutionError::UnsupportedBinaryOperator(operator, left, right)) => format!(
                "`{operator}` does not go with {left:?} and {right:?}; whole numbers and others do not mix: write `double(x)`"
            ),
            Err(problem) => problem.to_string(),
        };
        Err(Box::new(Diagnostic::new(Code::Value, self.text.span.clone(), message)))
    }
}

fn identifier(name: &str) -> String {
    name.replace(['.', '-'], "_")
}

/// RON as the language knows it; a word that is no value is its text.
fn value(ron: &str) -> Value {
    let word = ron.starts_with(|c: char| c.is_alphabetic()) && !["true", "false"].contains(&ron);
    match ron::from_str(ron) {
        Ok(value) if !word => convert(value),
        _ => ron.to_owned().into(),
    }
}

fn convert(value: ron::Value) -> Value {
    match value {
        ron::Value::Bool(truth) => truth.into(),
        ron::Value::String(text) => text.into(),
        ron::Value::Char(letter) => letter.to_string().into(),
        ron::Value::Seq(values) => values.into_iter().map(convert).collect::<Vec<_>>().into(),
        ron::Value::Number(number) => match number.into_f64() {
            whole if whole.fract() == 0.0 && whole.abs() < 9e15 => (whole as i64).into(),
            other => other.into(),
        },
        ron::Value::Map(map) => {
            let named = |(name, value)| match name {
                ron::Value::String(name) => Some((name, convert(value))),
                _ => None,
            };
            let named: std::collections::HashMap<String, Value> =
                map.into_iter().filter_map(named).collect();
            named.into()
        }
        _ => Value::Null,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::{Source, Span};
    use std::sync::Arc;

    fn ask(text: &str, values: &[(&str, &str)]) -> Result<bool, String> {
        let values = values.iter().map(|(n, v)| ((*n).to_owned(), (*v).to_owned())).collect();
        let source = Arc::new(Source { path: "s".into(), text: text.into() });
        let text = Text { text: text.into(), span: Span { range: 0..text.len(), source } };
        let told = |d: Box<Diagnostic>| format!("{}; {}", d.message, d.help.unwrap_or_default());
        Condition::new(&text, &values).and_then(|c| c.holds(&values)).map_err(told)
    }

    #[test]
    fn numbers_tuples_and_words_compare() {
        let values =
            [("columns", "400"), ("rows", "(5, 10)"), ("node.choose", "max"), ("clamp", "0.5")];
        for (text, expected) in [
            ("columns > 4 * rows[0] * rows[1]", true),
            ("columns > 8 * rows[0] * rows[1]", false),
            ("node_choose == 'max' && clamp < 1", true),
            ("node_choose in ['random', 'medoid']", false),
        ] {
            assert_eq!(ask(text, &values), Ok(expected), "{text}");
        }
    }

    #[test]
    fn what_is_no_condition_is_told() {
        let values = [("columns", "400"), ("clamp", "0.5")];
        for (text, part) in [
            ("colums > 3", "there is no variable `colums`; did you mean `columns`?"),
            ("columns >", "not a condition: "),
            ("columns + 1", "expected a truth value, found Int(401)"),
            ("columns * 0.5 > 1.0", "whole numbers and others do not mix"),
        ] {
            let told = ask(text, &values).unwrap_err();
            assert!(told.contains(part), "{text}: {told}");
        }
    }
}
