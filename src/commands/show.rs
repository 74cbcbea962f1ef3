//! placeholder
use super::session::Failure; use super::Common; use crate::registry::Registry;
#[derive(clap::Args)] pub struct Show {}
impl Show { pub fn run(&self, _: &Common, _: &Registry) -> Result<(), Failure> { Ok(()) } }
