//! What an import repaired or left out, counted by kind.

use crate::node::Ctx;
use std::cell::RefCell;
use std::collections::BTreeMap;

/// Kinds of events, each with how often it happened and where it happened first.
#[derive(Default)]
pub(super) struct Notes(RefCell<BTreeMap<&'static str, (u64, String)>>);

impl Notes {
    /// Counts one more `what`, seen at `place`.
    pub(super) fn count(&self, what: &'static str, place: &str) {
        self.add(what, 1, place);
    }

    /// Counts `n` more, if any.
    pub(super) fn add(&self, what: &'static str, n: u64, place: &str) {
        if n > 0 {
            let mut notes = self.0.borrow_mut();
            notes.entry(what).or_insert_with(|| (0, place.to_owned())).0 += n;
        }
    }

    /// Tells them all to the record of the run.
    pub(super) fn tell(&self, ctx: &Ctx) {
        for (what, (n, place)) in self.0.borrow().iter() {
            ctx.note(format!("{n} {what} (first: {place})"));
        }
    }
}
