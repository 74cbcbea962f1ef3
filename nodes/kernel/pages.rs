//! Arrays that are walked at random: on large pages where the system has them, so that address translation is not
//! what a ray waits for.

use bytemuck::Pod;
use memmap2::MmapMut;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};

/// The size of a large page. Smaller arrays live on the heap.
const LARGE: usize = 1 << 21;

/// A fixed number of zeroed elements.
#[derive(Debug)]
pub struct Paged<T> {
    store: Store<T>,
    len: usize,
}

#[derive(Debug)]
enum Store<T> {
    Heap(Vec<T>),
    Mapped(MmapMut, PhantomData<T>),
}

impl<T: Pod> Paged<T> {
    /// `len` zeros.
    pub fn zeroed(len: usize) -> Self {
        let bytes = len * size_of::<T>();
        let mapped = (bytes >= LARGE).then(|| MmapMut::map_anon(bytes)).and_then(Result::ok);
        let Some(map) = mapped else {
            return Self { store: Store::Heap(vec![T::zeroed(); len]), len };
        };
        // A wish, of which nothing but speed depends.
        #[cfg(target_os = "linux")]
        let _ = map.advise(memmap2::Advice::HugePage);
        Self { store: Store::Mapped(map, PhantomData), len }
    }
}

impl<T: Pod> Deref for Paged<T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        match &self.store {
            Store::Heap(values) => values,
            Store::Mapped(map, _) => bytemuck::cast_slice(&map[..self.len * size_of::<T>()]),
        }
    }
}

impl<T: Pod> DerefMut for Paged<T> {
    #[inline(always)]
    fn deref_mut(&mut self) -> &mut [T] {
        match &mut self.store {
            Store::Heap(values) => values,
            Store::Mapped(map, _) => {
                bytemuck::cast_slice_mut(&mut map[..self.len * size_of::<T>()])
            }
        }
    }
}

impl<T: Pod> Clone for Paged<T> {
    fn clone(&self) -> Self {
        Self::from(&**self)
    }
}

impl<T: Pod + PartialEq> PartialEq for Paged<T> {
    fn eq(&self, other: &Self) -> bool {
        **self == **other
    }
}

impl<T: Pod> From<&[T]> for Paged<T> {
    fn from(values: &[T]) -> Self {
        let mut paged = Self::zeroed(values.len());
        paged.copy_from_slice(values);
        paged
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_and_small_arrays_hold_what_was_put_in() {
        for len in [0, 5, 3 * LARGE / 4 + 1] {
            let values: Vec<u32> = (0..len as u32).collect();
            let mut paged = Paged::from(values.as_slice());
            assert_eq!(*paged, *values);
            assert_eq!(paged.clone(), paged);
            paged.iter_mut().for_each(|value| *value += 1);
            assert!(paged.iter().zip(1..).all(|(a, b)| *a == b));
            assert_eq!(paged.len(), len);
        }
    }
}
