//! `--set`: a value given beside the file, for a variable (`size=(64, 36)`) or a field of a node
//! (`rows.seed=2`).

use super::diagnostic::{Code, Diagnostic, Source, Span};
use super::syntax::parse;
use super::tree::{Shape, Value};
use std::sync::Arc;

/// A `--set` as it was given: `name=value` or `node.field=value`, the value in RON. A bare word that
/// is no RON is taken as a string, so that paths need no second pair of quotes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Override(pub String);

/// An [`Override`] taken apart.
pub struct Setting {
    /// The node, when a field of a node is set.
    pub node: Option<Span>,
    /// The field or the variable.
    pub name: Span,
    /// What it is set to.
    pub value: Value,
}

impl Override {
    /// Takes it apart.
    ///
    /// # Errors
    /// When there is no `=` with something on both sides, or the value is broken RON.
    pub fn read(&self) -> Result<Setting, Vec<Diagnostic>> {
        let source = Arc::new(Source { path: "<--set>".into(), text: self.0.clone() });
        let span = |from: usize, to: usize| Span { source: Arc::clone(&source), range: from..to };
        let all = span(0, self.0.len());
        let form = || Some("write `variable=value` or `node.field=value`".to_owned());
        let Some(equals) = self.0.find('=') else {
            return Err(vec![Diagnostic::new(Code::Set, all, "there is no `=`").help(form())]);
        };
        let key = self.0[..equals].trim();
        let start = self.0.find(key).unwrap_or(0);
        if key.is_empty() || self.0[equals + 1..].trim().is_empty() {
            return Err(vec![
                Diagnostic::new(Code::Set, all, "something must stand on both sides of `=`")
                    .help(form()),
            ]);
        }
        let value = value_at(&source, equals + 1)?;
        let end = start + key.len();
        Ok(match key.find('.') {
            Some(dot) => Setting {
                node: Some(span(start, start + dot)),
                name: span(start + dot + 1, end),
                value,
            },
            None => Setting { node: None, name: span(start, end), value },
        })
    }
}

/// Reads the value that fills `source` from byte `from` to its end; a bare word that is no RON is a string.
///
/// # Errors
/// What is wrong with a value that starts as a string or with a bracket, and so is meant as RON.
pub fn value_at(source: &Arc<Source>, from: usize) -> Result<Value, Vec<Diagnostic>> {
    let text = source.text[from..].trim();
    let from = source.text.len() - source.text[from..].trim_start().len();
    let parsed = parse(source, from);
    match parsed.value {
        Some(value) if parsed.mistakes.is_empty() => {
            let plain = !matches!(value.shape, Shape::Word)
                || ["true", "false", "None", "inf", "NaN"].contains(&text);
            if plain {
                return Ok(value);
            }
        }
        _ if text.starts_with(['(', '[', '{', '"']) => return Err(parsed.mistakes),
        _ => {}
    }
    let span = Span { source: Arc::clone(source), range: from..from + text.len() };
    Ok(Value { span, shape: Shape::Text(text.to_owned()) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn takes_apart() {
        for (text, node, name, ron) in [
            ("size=(64, 36)", None, "size", "(64, 36)"),
            (" rows.seed = 2 ", Some("rows"), "seed", "2"),
            ("file=../scenes/x=1.glb", None, "file", "\"../scenes/x=1.glb\""),
            ("a.file=3d.glb", Some("a"), "file", "\"3d.glb\""),
            ("a.pick=max", Some("a"), "pick", "\"max\""),
            ("a.pick=r#\"x\"#", Some("a"), "pick", "\"x\""),
            ("a.map=None", Some("a"), "map", "None"),
            ("a.size=$size", Some("a"), "size", "\"$size\""),
            ("n=1e3", None, "n", "1e3"),
        ] {
            let set = Override(text.into()).read().unwrap_or_else(|e| panic!("{text}: {e:?}"));
            assert_eq!(set.node.as_ref().map(Span::text), node, "{text}");
            assert_eq!((set.name.text(), &*set.value.ron()), (name, ron), "{text}");
        }
    }

    #[test]
    fn refuses() {
        for (text, part) in [
            ("size", "no `=`"),
            ("size= ", "both sides"),
            ("=3", "both sides"),
            ("", "no `=`"),
            ("size=(64, 36", "not closed"),
            ("file=\"x", "not closed"),
        ] {
            let errors = Override(text.into()).read().map(|_| ()).unwrap_err();
            assert!(
                errors[0].message.contains(part) && errors[0].file() == "<--set>",
                "{text}: {errors:?}"
            );
        }
    }
}
