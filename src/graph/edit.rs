//! Editing a graph file in place: only the bytes of one value change, comments and layout stay.

use super::diagnostic::{Code, Diagnostic, Source, Span, suggest};
use super::file::nearest_node;
use super::set::value_at;
use super::syntax::parse;
use super::tree::{Field, Shape};
use std::sync::Arc;

/// Gives the parameter or port `field` of `node` another value, and the text that results. The field is
/// added when the node does not have it yet; a variable that stood there stands no longer. Whether the
/// value fits is for [`Graph::read`](super::Graph::read) to tell.
///
/// # Errors
/// When the text or the value is broken RON, or there is no such node.
pub fn set_value(
    text: &str,
    path: &str,
    node: &str,
    field: &str,
    ron: &str,
) -> Result<String, Box<Diagnostic>> {
    let edit = Edit::new(text, path, node, ron)?;
    if field.is_empty() || !field.chars().all(|c| c.is_alphanumeric() || c == '_') {
        return Err(Diagnostic::new(
            Code::Name,
            edit.given,
            format!("{field:?} cannot be the name of a field"),
        )
        .into());
    }
    let nodes = edit.section("nodes")?;
    let Some(found) = nodes.iter().find(|f| f.name == node) else {
        let help = nearest_node(node, nodes.iter().map(|f| &*f.name));
        return Err(Diagnostic::new(Code::Node, edit.given, format!("there is no node {node:?}"))
            .help(help)
            .into());
    };
    let kind_only = |end: usize| Ok(edit.splice(end, end, &format!("({field}: {})", edit.ron)));
    match &found.value.shape {
        Shape::Fields(Some(_), fields) => match fields.iter().find(|f| f.name == field) {
            Some(old) => {
                Ok(edit.splice(old.value.span.range.start, old.value.span.range.end, &edit.ron))
            }
            None => {
                Ok(edit.add(fields, found.value.span.range.end, &format!("{field}: {}", edit.ron)))
            }
        },
        Shape::Word => kind_only(found.value.span.range.end),
        _ => Err(Diagnostic::new(Code::Kind, found.value.span.clone(), "expected a node")
            .help("write `Kind(field: value)`".to_owned())
            .into()),
    }
}

/// Gives the variable `name` another value, and the text that results.
///
/// # Errors
/// When the text or the value is broken RON, or there is no such variable.
pub fn set_variable(
    text: &str,
    path: &str,
    name: &str,
    ron: &str,
) -> Result<String, Box<Diagnostic>> {
    let edit = Edit::new(text, path, name, ron)?;
    let vars = edit.section("vars")?;
    match vars.iter().find(|f| f.name == name) {
        Some(old) => {
            Ok(edit.splice(old.value.span.range.start, old.value.span.range.end, &edit.ron))
        }
        None => {
            let help = suggest(name, vars.iter().map(|f| &*f.name), "variables");
            Err(Diagnostic::new(
                Code::Variable,
                edit.given,
                format!("there is no variable `{name}`"),
            )
            .help(help)
            .into())
        }
    }
}

struct Edit {
    source: Arc<Source>,
    fields: Vec<Field>,
    ron: String,
    /// The name that was asked for, as a text of its own.
    given: Span,
}

impl Edit {
    fn new(text: &str, path: &str, name: &str, ron: &str) -> Result<Self, Box<Diagnostic>> {
        let first = |mistakes: Vec<Diagnostic>, source: &Arc<Source>| {
            let end = Span { source: Arc::clone(source), range: 0..0 };
            let none = || Diagnostic::new(Code::Syntax, end, "expected `Graph(`");
            Box::new(mistakes.into_iter().next().unwrap_or_else(none))
        };
        let value = Arc::new(Source { path: "<value>".into(), text: ron.into() });
        let ron = value_at(&value, 0).map_err(|wrong| first(wrong, &value))?;
        if ron.span.range.is_empty() {
            return Err(Diagnostic::new(Code::Set, ron.span, "there is no value").into());
        }
        let source = Arc::new(Source { path: path.into(), text: text.into() });
        let parsed = parse(&source, 0);
        let fields = match parsed.value.map(|v| v.shape) {
            Some(Shape::Fields(_, fields)) if parsed.mistakes.is_empty() => fields,
            _ => return Err(first(parsed.mistakes, &source)),
        };
        let name = Arc::new(Source { path: "<name>".into(), text: name.into() });
        let given = Span { range: 0..name.text.len(), source: name };
        Ok(Edit { source, fields, ron: ron.ron(), given })
    }

    fn section(&self, name: &str) -> Result<&[Field], Box<Diagnostic>> {
        match self.fields.iter().find(|f| f.name == name).map(|f| &f.value.shape) {
            Some(Shape::Map(entries)) => Ok(entries),
            _ => Err(Diagnostic::new(
                Code::Field,
                self.given.clone(),
                format!("the file has no `{name}`"),
            )
            .into()),
        }
    }

    fn splice(&self, start: usize, end: usize, new: &str) -> String {
        let text = &self.source.text;
        format!("{}{new}{}", &text[..start], &text[end..])
    }

    /// Adds a field after the last one: on a line of its own where the last one has one.
    fn add(&self, fields: &[Field], node_end: usize, field: &str) -> String {
        let text = &self.source.text;
        let Some(last) = fields.last() else {
            return self.splice(node_end - 1, node_end - 1, field);
        };
        let (key, end) = (last.key.range.start, last.value.span.range.end);
        let line_start = text[..key].rfind('\n').map_or(0, |i| i + 1);
        let indent = &text[line_start..key];
        let line_end = text[end..].find('\n').map_or(text.len(), |i| end + i);
        let rest = text[end..line_end].trim_start();
        let after = rest.strip_prefix(',').unwrap_or(rest).trim();
        if !indent.trim().is_empty() || !(after.is_empty() || after.starts_with("//")) {
            return self.splice(end, end, &format!(", {field}"));
        }
        let comma = if rest.starts_with(',') { "" } else { "," };
        format!(
            "{}{comma}{}\n{indent}{field},{}",
            &text[..end],
            &text[end..line_end],
            &text[line_end..]
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "// A shot.
Graph(
    vars: { \"size\": (64, 36) /* px */ },
    nodes: {
        \"a\": Frames(first: 0, last: 39),   // all
        \"b\": Rows(
            bins: (10, /* square */ 10),
            seed: 1,   // any
        ),
        \"c\": Lamp,
        \"d\": Lamp( ),
        \"e\": Rows(
            seed: 1   // last
        ),
    },
)
";

    fn set(node: &str, field: &str, ron: &str) -> String {
        set_value(FILE, "a.ron", node, field, ron).unwrap_or_else(|e| panic!("{}", e.render(false)))
    }

    #[test]
    fn only_the_value_changes() {
        assert_eq!(set("a", "last", "59"), FILE.replace("last: 39", "last: 59"));
        assert_eq!(set("b", "bins", "(12, 12)"), FILE.replace("(10, /* square */ 10)", "(12, 12)"));
        assert_eq!(
            set("b", "seed", "maps/sky.exr"),
            FILE.replace("seed: 1,", "seed: \"maps/sky.exr\",")
        );
        let size = set_variable(FILE, "a.ron", "size", "(1, 2)").unwrap();
        assert_eq!(size, FILE.replace("(64, 36)", "(1, 2)"));
    }

    #[test]
    fn new_fields_follow_the_layout() {
        assert_eq!(set("a", "fps", "20"), FILE.replace("last: 39", "last: 39, fps: 20"));
        assert_eq!(
            set("b", "norm", "true"),
            FILE.replace("// any\n", "// any\n            norm: true,\n")
        );
        assert_eq!(set("c", "power", "2"), FILE.replace("\"c\": Lamp", "\"c\": Lamp(power: 2)"));
        assert_eq!(set("d", "power", "2"), FILE.replace("Lamp( )", "Lamp( power: 2)"));
        let last =
            FILE.replace("seed: 1   // last\n", "seed: 1,   // last\n            norm: true,\n");
        assert_eq!(set("e", "norm", "true"), last);
    }

    #[test]
    fn refuses() {
        let wrong = |result: Result<String, Box<Diagnostic>>| result.unwrap_err().message;
        assert!(wrong(set_value(FILE, "a.ron", "aa", "last", "1")).contains("no node"));
        assert!(wrong(set_value(FILE, "a.ron", "a", "last", "(1")).contains("not closed"));
        assert!(wrong(set_value(FILE, "a.ron", "a", "last", " ")).contains("no value"));
        assert!(wrong(set_value(FILE, "a.ron", "a", "x: 1, y", "1")).contains("field"));
        assert!(
            wrong(set_value("Graph(nodes: {", "a.ron", "a", "last", "1")).contains("not closed")
        );
        assert!(wrong(set_value("", "a.ron", "a", "last", "1")).contains("found the end"));
        assert!(wrong(set_variable(FILE, "a.ron", "rows", "1")).contains("no variable"));
        assert!(wrong(set_variable("Graph()", "a.ron", "rows", "1")).contains("has no `vars`"));
    }
}
