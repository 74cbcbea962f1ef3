//! What is said about a mistake: where it is, what was meant, and how it looks on a terminal.

use annotate_snippets::{AnnotationKind, Level, Renderer, Snippet};
use std::ops::Range;
use std::sync::Arc;

/// A text that spans point into: the graph file, or one `--set`.
#[derive(Debug, PartialEq, Eq)]
pub struct Source {
    /// How messages call it: the path as the user gave it, or `<--set>`.
    pub path: String,
    /// All of it.
    pub text: String,
}

/// A piece of a [`Source`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Span {
    /// The text it is in.
    pub source: Arc<Source>,
    /// Its bytes; never beyond the text.
    pub range: Range<usize>,
}

impl Span {
    /// Line and column of its first character, both from 1; columns count characters.
    pub fn line_column(&self) -> (usize, usize) {
        let before = self.source.text.get(..self.range.start).unwrap_or(&self.source.text);
        let line_start = before.rfind('\n').map_or(0, |i| i + 1);
        (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
    }

    /// `path:line:column`.
    pub fn place(&self) -> String {
        let (line, column) = self.line_column();
        format!("{}:{line}:{column}", self.source.path)
    }

    /// Whether it lies in `outer`.
    pub fn within(&self, outer: &Span) -> bool {
        let (a, b) = (&self.range, &outer.range);
        b.start <= a.start && a.end <= b.end && Arc::ptr_eq(&self.source, &outer.source)
    }

    /// The text itself.
    pub fn text(&self) -> &str {
        self.source.text.get(self.range.clone()).unwrap_or_default()
    }
}

/// What kind of mistake it is; printed as `G001` and so on. The numbers do not change.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Code {
    /// The text is not RON.
    Syntax = 1,
    /// A field of `Graph` that there is not, or of another shape.
    Field,
    /// A kind of node that there is not.
    Kind,
    /// A parameter or port that the node has not.
    Input,
    /// A parameter or port that must be given.
    Missing,
    /// A parameter's value of another type or out of range.
    Value,
    /// Parameters that do not fit together.
    Check,
    /// A node that there is not.
    Node,
    /// A node that gives something else than the port takes.
    Type,
    /// Several nodes, or none, where the port takes one; a value where a node is named.
    Shape,
    /// Nodes that need each other.
    Cycle,
    /// A name that is given twice.
    Duplicate,
    /// A variable that there is not, or that cannot be used so.
    Variable,
    /// A variable that nothing uses; a warning.
    Unused,
    /// No node, or no output.
    Empty,
    /// An output of a node whose artifact is not published.
    Output,
    /// Sequences that do not go together.
    Axis,
    /// A `--set` that is not understood.
    Set,
    /// A name with characters that names may not have.
    Name,
}

/// One mistake, or one warning.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// What kind of mistake.
    pub code: Code,
    /// Whether the graph can be used nevertheless.
    pub warning: bool,
    /// What is wrong, in one line.
    pub message: String,
    /// Where.
    pub span: Span,
    /// What is to be seen there; may be empty.
    pub label: String,
    /// Other places that belong to it, each with what is to be seen there.
    pub related: Vec<(Span, String)>,
    /// What to do about it.
    pub help: Option<String>,
}

impl Diagnostic {
    /// A mistake at `span`.
    pub fn new(code: Code, span: Span, message: impl Into<String>) -> Self {
        Diagnostic {
            code,
            warning: false,
            message: message.into(),
            span,
            label: String::new(),
            related: Vec::new(),
            help: None,
        }
    }

    /// With what is to be seen at its place.
    #[must_use]
    pub fn label(mut self, label: impl Into<String>) -> Self {
        self.label = label.into();
        self
    }

    /// With one more place.
    #[must_use]
    pub fn related(mut self, span: Span, label: impl Into<String>) -> Self {
        self.related.push((span, label.into()));
        self
    }

    /// With what to do about it.
    #[must_use]
    pub fn help(mut self, help: impl Into<Option<String>>) -> Self {
        self.help = help.into();
        self
    }

    /// The code as printed: `G001`.
    pub fn id(&self) -> String {
        format!("G{:03}", self.code as u32)
    }

    /// The path of the text it is in.
    pub fn file(&self) -> &str {
        &self.span.source.path
    }

    /// The whole message with excerpts, as a compiler prints it; `color` with terminal escapes.
    pub fn render(&self, color: bool) -> String {
        let level = if self.warning { Level::WARNING } else { Level::ERROR };
        let mut group = level
            .primary_title(&*self.message)
            .id(self.id())
            .element(self.snippet(&self.span.source));
        let mut shown = vec![&self.span.source];
        for (span, _) in &self.related {
            if !shown.iter().any(|s| Arc::ptr_eq(s, &span.source)) {
                shown.push(&span.source);
                group = group.element(self.snippet(&span.source));
            }
        }
        if let Some(help) = &self.help {
            group = group.element(Level::HELP.message(&**help));
        }
        let renderer = if color { Renderer::styled() } else { Renderer::plain() };
        renderer.render(&[group])
    }

    /// The lines of `source` that matter here: the renderer need not read a large file for each message.
    fn snippet<'a>(
        &'a self,
        source: &'a Arc<Source>,
    ) -> Snippet<'a, annotate_snippets::Annotation<'a>> {
        let primary = std::iter::once((&self.span, &self.label, AnnotationKind::Primary));
        let context =
            self.related.iter().map(|(span, label)| (span, label, AnnotationKind::Context));
        let here: Vec<_> =
            primary.chain(context).filter(|(span, ..)| Arc::ptr_eq(&span.source, source)).collect();
        let first = here.iter().map(|(span, ..)| span.range.start).min().unwrap_or(0);
        let last = here.iter().map(|(span, ..)| span.range.end).max().unwrap_or(0);
        let start = source.text[..first].rfind('\n').map_or(0, |i| i + 1);
        let end = source.text[last..].find('\n').map_or(source.text.len(), |i| last + i);
        let line = source.text[..start].matches('\n').count() + 1;
        let snippet =
            Snippet::source(&source.text[start..end]).path(&*source.path).line_start(line);
        snippet.annotations(here.into_iter().map(|(span, label, kind)| {
            let label = (!label.is_empty()).then_some(&**label);
            kind.span(span.range.start - start..span.range.end - start).label(label)
        }))
    }
}

/// The name that was probably meant, if one of `names` is near enough to `wrong`.
pub fn nearest<'a>(wrong: &str, names: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    /// Enough for any graph that people write; keeps a generated one with a thousand mistakes quick.
    const LOOKED_AT: usize = 1000;
    let lower = wrong.to_lowercase();
    let distance = |name: &str| strsim::damerau_levenshtein(&lower, &name.to_lowercase());
    let scored = names.into_iter().take(LOOKED_AT).map(|name| (distance(name), name));
    scored
        .filter(|(d, name)| *d * 3 <= name.chars().count().max(3))
        .min_by_key(|(d, _)| *d)
        .map(|(_, name)| name)
}

/// `did you mean ...?`, or else what there is.
pub fn suggest<'a>(
    wrong: &str,
    names: impl IntoIterator<Item = &'a str> + Clone,
    what: &str,
) -> Option<String> {
    const LISTED: usize = 12;
    if let Some(name) = nearest(wrong, names.clone()) {
        return Some(format!("did you mean `{name}`?"));
    }
    let mut names: Vec<&str> = names.into_iter().take(LISTED + 1).collect();
    let more = names.len() > LISTED;
    names.truncate(LISTED);
    let dots = if more { ", ..." } else { "" };
    (!names.is_empty()).then(|| format!("{what}: {}{dots}", names.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn span(text: &str, range: Range<usize>) -> Span {
        Span { source: Arc::new(Source { path: "a.ron".into(), text: text.into() }), range }
    }

    #[test]
    fn columns_count_characters() {
        let at = span("ab\ncdé = 3", 8..9);
        assert_eq!(at.line_column(), (2, 5));
        assert_eq!(at.place(), "a.ron:2:5");
    }

    #[test]
    fn render_shows_only_what_matters_with_true_line_numbers() {
        let at = span("one\ntwo\nthree\nfour\n", 8..13);
        let text = Diagnostic::new(Code::Name, at, "bad name")
            .label("here")
            .help("x".to_owned())
            .render(false);
        assert_eq!(
            text,
            "error[G019]: bad name\n --> a.ron:3:1\n  |\n3 | three\n  | ^^^^^ here\n  |\n  = help: x"
        );
    }

    #[test]
    fn renders_at_the_end_of_an_empty_text() {
        assert!(
            Diagnostic::new(Code::Syntax, span("", 0..0), "empty").render(true).contains("empty")
        );
    }

    #[test]
    fn nearest_names() {
        assert_eq!(nearest("geomtry", ["camera", "geometry"]), Some("geometry"));
        assert_eq!(nearest("Fps", ["first", "fps"]), Some("fps"));
        assert_eq!(nearest("zebra", ["camera", "geometry"]), None);
        assert_eq!(
            suggest("zebra", ["camera", "fps"], "it has"),
            Some("it has: camera, fps".into())
        );
    }
}
