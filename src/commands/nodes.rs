//! placeholder
use super::session::Failure; use super::Common; use crate::registry::Registry;
#[derive(clap::Args)] pub struct Nodes {}
impl Nodes { pub fn run(&self, _: &Common, _: &Registry) -> Result<(), Failure> { Ok(()) } }
