//! The types that a parameter may have: each is read from RON text, and has one canonical text.

use std::fmt::Write as _;
use std::path::PathBuf;

/// A type that a parameter may have.
pub trait ParamValue: Clone + Default + Send + Sync + 'static {
    /// The type's name for people.
    fn kind() -> String;
    /// Reads RON text; finite numbers only.
    ///
    /// # Errors
    /// What was expected.
    fn parse(ron: &str) -> Result<Self, String>;
    /// Text that [`ParamValue::parse`] reads back to the same bits.
    fn show(&self) -> String;
    /// The path, if this is a file.
    fn path(&mut self) -> Option<&mut PathBuf> {
        None
    }
}

/// A file parameter: keyed by content, never by its path's text.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct File(pub PathBuf);

impl ParamValue for File {
    fn kind() -> String {
        "file".into()
    }
    fn parse(ron: &str) -> Result<Self, String> {
        let text: String = ron::from_str(ron).map_err(|_| expected("a path in quotes", ron))?;
        if text.is_empty() { Err("the path is empty".into()) } else { Ok(File(text.into())) }
    }
    fn show(&self) -> String {
        format!("{:?}", self.0.display().to_string())
    }
    fn path(&mut self) -> Option<&mut PathBuf> {
        Some(&mut self.0)
    }
}

/// A closed set of words. Implemented by [`choice!`](crate::choice).
pub trait Choice: Clone + Copy + Default + PartialEq + Send + Sync + 'static {
    /// Every value with its word.
    const WORDS: &'static [(&'static str, Self)];
}

impl<T: Choice> ParamValue for T {
    fn kind() -> String {
        T::WORDS.iter().map(|(word, _)| *word).collect::<Vec<_>>().join(" | ")
    }
    fn parse(ron: &str) -> Result<Self, String> {
        let word = ron.trim().trim_matches('"');
        let found = T::WORDS.iter().find(|(w, _)| *w == word);
        found
            .map(|(_, value)| *value)
            .ok_or_else(|| expected(&format!("one of {}", Self::kind()), ron))
    }
    fn show(&self) -> String {
        T::WORDS
            .iter()
            .find(|(_, value)| value == self)
            .map(|(word, _)| (*word).to_owned())
            .unwrap_or_default()
    }
}

fn expected(what: &str, found: &str) -> String {
    let found = found.trim();
    let shown: String = found.chars().take(40).collect();
    let dots = if shown.len() < found.len() { "..." } else { "" };
    format!("expected {what}, found `{shown}{dots}`")
}

/// Reads a finite number from RON text; `what` names the expectation in the error.
///
/// # Errors
/// When the text is no number, or is out of the range of a finite `f64`.
pub fn parse_number(ron: &str, what: &str) -> Result<f64, String> {
    let value: f64 = ron::from_str(ron).map_err(|_| expected(what, ron))?;
    if value.is_finite() { Ok(value) } else { Err(expected("a finite number", ron)) }
}

macro_rules! integers {
    ($($t:ty),*) => {$(
        impl ParamValue for $t {
            fn kind() -> String { "integer".into() }
            fn parse(ron: &str) -> Result<Self, String> {
                ron::from_str(ron).map_err(|_| {
                    expected(&format!("an integer from {} to {}", <$t>::MIN, <$t>::MAX), ron)
                })
            }
            fn show(&self) -> String { self.to_string() }
        }
    )*};
}
integers!(u32, u64);

impl ParamValue for f64 {
    fn kind() -> String {
        "number".into()
    }
    fn parse(ron: &str) -> Result<Self, String> {
        // Adding zero turns -0.0 into 0.0, so that the two have one canonical text.
        parse_number(ron, "a number").map(|v| v + 0.0)
    }
    fn show(&self) -> String {
        format!("{self:?}")
    }
}

impl ParamValue for f32 {
    fn kind() -> String {
        "number".into()
    }
    fn parse(ron: &str) -> Result<Self, String> {
        let wide = parse_number(ron, "a number")?;
        let value = wide as f32 + 0.0;
        if !value.is_finite() {
            return Err(expected(&format!("a number of at most {:e} in size", f32::MAX), ron));
        }
        if value == 0.0 && wide != 0.0 {
            return Err(expected(
                &format!("0 or a number of at least {:e} in size", f32::MIN_POSITIVE),
                ron,
            ));
        }
        Ok(value)
    }
    fn show(&self) -> String {
        format!("{self:?}")
    }
}

impl ParamValue for bool {
    fn kind() -> String {
        "true | false".into()
    }
    fn parse(ron: &str) -> Result<Self, String> {
        ron::from_str(ron).map_err(|_| expected("true or false", ron))
    }
    fn show(&self) -> String {
        self.to_string()
    }
}

impl<T: ParamValue + PartialEq, const N: usize> ParamValue for [T; N]
where
    [T; N]: Default,
{
    fn kind() -> String {
        format!("({})", vec![T::kind(); N].join(", "))
    }
    fn parse(ron: &str) -> Result<Self, String> {
        let parts: Vec<&ron::value::RawValue> =
            tuple_parts::<N>(ron).ok_or_else(|| expected(&Self::kind(), ron))?;
        let mut values = <[T; N]>::default();
        for (value, part) in values.iter_mut().zip(parts) {
            *value = T::parse(part.get_ron())?;
        }
        Ok(values)
    }
    fn show(&self) -> String {
        let mut text = String::from("(");
        for (i, value) in self.iter().enumerate() {
            let _ = write!(text, "{}{}", if i > 0 { ", " } else { "" }, value.show());
        }
        text + ")"
    }
}

fn tuple_parts<const N: usize>(ron: &str) -> Option<Vec<&ron::value::RawValue>> {
    fn as_two(ron: &str) -> Option<Vec<&ron::value::RawValue>> {
        ron::from_str::<(&ron::value::RawValue, &ron::value::RawValue)>(ron)
            .ok()
            .map(|t| vec![t.0, t.1])
    }
    fn as_three(ron: &str) -> Option<Vec<&ron::value::RawValue>> {
        type Raw<'a> = &'a ron::value::RawValue;
        ron::from_str::<(Raw<'_>, Raw<'_>, Raw<'_>)>(ron).ok().map(|t| vec![t.0, t.1, t.2])
    }
    match N {
        2 => as_two(ron),
        3 => as_three(ron),
        _ => None,
    }
}

/// An optional parameter: `None`, or the value itself.
impl<T: ParamValue> ParamValue for Option<T> {
    fn kind() -> String {
        format!("{} or None", T::kind())
    }
    fn parse(ron: &str) -> Result<Self, String> {
        let text = ron.trim();
        if text == "None" {
            return Ok(None);
        }
        let inner = text.strip_prefix("Some(").and_then(|t| t.strip_suffix(')')).unwrap_or(text);
        T::parse(inner).map(Some)
    }
    fn show(&self) -> String {
        self.as_ref().map_or_else(|| "None".into(), T::show)
    }
    fn path(&mut self) -> Option<&mut PathBuf> {
        self.as_mut().and_then(T::path)
    }
}

/// Declares a parameter type that is one of a few words; the first is the default.
#[macro_export]
macro_rules! choice {
    ( $(#[$meta:meta])* pub enum $name:ident { $( $(#[doc = $doc:literal])* $variant:ident = $word:literal ),* $(,)? } ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $name { $( $(#[doc = $doc])* $variant ),* }
        impl Default for $name {
            fn default() -> Self { <$name as $crate::node::Choice>::WORDS[0].1 }
        }
        impl $crate::node::Choice for $name {
            const WORDS: &'static [(&'static str, Self)] = &[$( ($word, $name::$variant) ),*];
        }
    };
}
