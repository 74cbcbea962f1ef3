//! The standard output.

use super::session::Failure;
use crate::engine::EngineError;
use std::fmt::Display;
use std::io::{ErrorKind, Write};

/// Writes `text`. A reader that has seen enough (`| head`) is no failure; a full disk is.
pub fn say(text: impl Display) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    match write!(out, "{text}").and_then(|()| out.flush()) {
        Err(cause) if cause.kind() != ErrorKind::BrokenPipe => {
            Err(EngineError::Io { path: "standard output".into(), cause }.into())
        }
        _ => Ok(()),
    }
}

/// Writes a JSON document on a line of its own.
pub fn say_json(value: &serde_json::Value) -> Result<(), Failure> {
    say(format_args!("{value}\n"))
}
