//! The list of what a walk has still to visit.

use bytemuck::Zeroable;

/// Deep enough for any hierarchy but a degenerate one, which spills.
const FIXED: usize = 64;

/// A stack that allocates only for degenerate hierarchies.
pub(super) struct Stack<T> {
    fixed: [T; FIXED],
    len: usize,
    spilled: Vec<T>,
}

impl<T: Zeroable + Copy> Stack<T> {
    /// A stack that holds `first`.
    #[inline(always)]
    pub(super) fn new(first: T) -> Self {
        // Zeros are written many at once, repetitions of `first` one by one.
        let mut fixed = [T::zeroed(); FIXED];
        fixed[0] = first;
        Self { fixed, len: 1, spilled: Vec::new() }
    }

    #[inline(always)]
    pub(super) fn push(&mut self, item: T) {
        if let Some(slot) = self.fixed.get_mut(self.len) {
            *slot = item;
            self.len += 1;
        } else {
            self.spilled.push(item);
        }
    }

    #[inline(always)]
    pub(super) fn pop(&mut self) -> Option<T> {
        if self.len == FIXED
            && let Some(item) = self.spilled.pop()
        {
            return Some(item);
        }
        self.len = self.len.checked_sub(1)?;
        self.fixed.get(self.len).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spilling_keeps_the_order() {
        let mut stack = Stack::new(0);
        (1..3 * FIXED).for_each(|i| stack.push(i));
        assert_eq!(stack.pop(), Some(3 * FIXED - 1));
        stack.push(7);
        assert_eq!(stack.pop(), Some(7));
        for i in (0..3 * FIXED - 1).rev() {
            assert_eq!(stack.pop(), Some(i));
        }
        assert_eq!(stack.pop(), None);
    }
}
