//! placeholder
use super::session::Failure; use crate::registry::Registry;
#[derive(clap::Args)] pub struct Draw {}
impl Draw { pub fn run(&self, _: &Registry) -> Result<(), Failure> { Ok(()) } }
