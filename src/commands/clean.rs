//! placeholder
use super::session::Failure; use super::Common;
#[derive(clap::Args)] pub struct Clean {}
impl Clean { pub fn run(&self, _: &Common) -> Result<(), Failure> { Ok(()) } }
