//! The gather of point-based global illumination: what a receiver sees of a hierarchy of surfels, through a micro-buffer
//! of its own (Christensen 2008; Buchholz and Boubekeur 2012, section 1.1).
//!
//! Down the page: [`MicroBuffer`] (the cells) <- `fragments` (depth) <- `disc` (large leaves) <- `cut` (the walk) <-
//! [`Gather`]. The front of a surfel sends its radiance; its back is not seen.
//!
//! That is how one receiver gathers. Many gather eight at a time, with the same result to the bit: `grouping` (which eight) ->
//! `packet` (their common walk, through `places`) -> `painting` (depth). Neighbours look at nearly the same nodes.

mod buffer;
mod cut;
mod disc;
mod fragments;
mod frame;
mod grouping;
mod packet;
mod painting;
mod places;

#[cfg(test)]
mod fixtures;
#[cfg(test)]
mod tests;

pub use buffer::{MicroBuffer, Shape};

use super::hierarchy::Hierarchy;
use crate::kernel::brdf::Reflectance;
use crate::kernel::element::Receiver;
use crate::kernel::lanes::{Lanes, Portable, WIDTH};
use buffer::Cell;
use cut::Cut;
use fragments::Fragments;
use frame::Frame;
use glam::Vec3;
use painting::{Layers, Painting};
use rayon::prelude::*;
use std::f32::consts::FRAC_PI_4;
use std::ops::Add;
use std::sync::atomic::{AtomicU64, Ordering};

/// Receivers of one piece of work.
const PIECE: usize = 64;

/// Roughness below which a lobe differs within a cell, and as far from its middle as so many of its widths.
const SHARP: f32 = 0.5;
const WIDTHS: f32 = 3.0;

/// Settings of a gather.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// A node is used without its children when its sphere's solid angle is below this many cells: 0 gathers from single
    /// surfels only. A splat is at most two cells wide, so more than 4 shows small what is large.
    pub factor: f32,
    /// Coverage from which a cell is full, 0.75 to 1. Surfels share out the area of their surface, so what they add up to
    /// in a cell scatters around 1, and harmonics of three bands give up to 8 % too little: at 1, which is the paper's
    /// rule, a few percent of what lies behind a wall shine through it. Coverage below 4 x this - 3 counts as it is.
    pub full: f32,
}

impl Default for Settings {
    fn default() -> Self {
        Settings { factor: 1.0, full: 0.9 }
    }
}

/// What one receiver gathers.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gathered {
    /// Radiance that leaves the receiver towards the eye, W/(m^2 sr) for surfels in that unit.
    pub radiance: Vec3,
    /// Ambient occlusion: the cosine-weighted share of directions in which there is no surfel, 0 to 1, of those above
    /// both of the receiver's normals.
    pub open: f32,
    /// Cosine-weighted mean of those directions, a unit vector in the world; zero where there is none.
    pub unoccluded: Vec3,
}

/// What gathering costs, on any machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Nodes looked at.
    pub visited: u64,
    /// Nodes used as splats: the cut, with `cast`.
    pub splatted: u64,
    /// Leaves cast against the rays of all cells.
    pub cast: u64,
    /// Parts of cells covered, by what is not known to be hidden when its turn comes: less for [`Gather::all`] than for
    /// [`Gather::one`].
    pub fragments: u64,
}

impl Add for Work {
    type Output = Work;

    fn add(self, other: Work) -> Work {
        Work {
            visited: self.visited + other.visited,
            splatted: self.splatted + other.splatted,
            cast: self.cast + other.cast,
            fragments: self.fragments + other.fragments,
        }
    }
}

/// Memory of one thread, used again for each of its receivers.
pub struct Scratch<H: Hierarchy> {
    stack: Vec<H::Node>,
    fragments: Fragments,
    shared: Vec<(H::Node, u32)>,
    layers: [Layers; WIDTH],
    painting: Painting,
}

impl<H: Hierarchy> Default for Scratch<H> {
    fn default() -> Self {
        Scratch {
            stack: Vec::new(),
            fragments: Fragments::default(),
            shared: Vec::new(),
            layers: Default::default(),
            painting: Painting::default(),
        }
    }
}

/// A gather from one hierarchy. `background` gives the radiance from infinitely far away along a unit vector of the world
/// that points there.
pub struct Gather<'a, H, B> {
    /// The surfels.
    pub hierarchy: &'a H,
    /// The cells through which they are seen.
    pub buffer: &'a MicroBuffer,
    /// Detail against time.
    pub settings: Settings,
    /// What is seen where there is no surfel; `|_| Vec3::ZERO` for nothing.
    pub background: B,
}

impl<H: Hierarchy, B: Fn(Vec3) -> Vec3 + Sync> Gather<'_, H, B> {
    /// What one receiver gathers, by a walk of its own: what [`Gather::all`] is held to. The cost is added to `work`.
    pub fn one(&self, receiver: &Receiver, scratch: &mut Scratch<H>, work: &mut Work) -> Gathered {
        let Scratch { stack, fragments, .. } = scratch;
        let frame = Frame::of(receiver.normal);
        fragments.clear(self.buffer.len());
        let cut = Cut::new(self.hierarchy, self.buffer, &self.settings, receiver, frame);
        cut.walk(stack, fragments, work);
        fragments.sort();
        work.fragments += fragments.len() as u64;
        let full = self.settings.full.clamp(0.75, 1.0);
        self.convolve(receiver, &frame, |cell| fragments.composite(cell, full))
    }

    /// [`Gather::few_in`] on the widest instruction set that the processor has.
    fn few(
        &self,
        receivers: &[Receiver],
        chosen: &[u32],
        gathered: &mut [Gathered],
        scratch: &mut Scratch<H>,
        work: &mut Work,
    ) {
        #[cfg(target_arch = "x86_64")]
        {
            use crate::kernel::lanes::Avx2;
            #[target_feature(enable = "avx2")]
            fn avx2<H: Hierarchy, B: Fn(Vec3) -> Vec3 + Sync>(
                gather: &Gather<'_, H, B>,
                receivers: &[Receiver],
                chosen: &[u32],
                gathered: &mut [Gathered],
                scratch: &mut Scratch<H>,
                work: &mut Work,
            ) {
                gather.few_in::<Avx2>(receivers, chosen, gathered, scratch, work);
            }
            if std::is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has AVX2.
                return unsafe { avx2(self, receivers, chosen, gathered, scratch, work) };
            }
        }
        self.few_in::<Portable>(receivers, chosen, gathered, scratch, work);
    }

    /// What 1 to 8 chosen receivers gather, in one walk: each what [`Gather::one`] gives, to the bit. They should be close to each
    /// other. The cost is added to `work`.
    #[inline(always)]
    fn few_in<L: Lanes>(
        &self,
        receivers: &[Receiver],
        chosen: &[u32],
        gathered: &mut [Gathered],
        scratch: &mut Scratch<H>,
        work: &mut Work,
    ) {
        let Scratch { shared, layers, painting, .. } = scratch;
        layers.iter_mut().for_each(Layers::clear);
        let cuts: Vec<_> = chosen
            .iter()
            .map(|&i| {
                let receiver = &receivers[i as usize];
                let frame = Frame::of(receiver.normal);
                Cut::new(self.hierarchy, self.buffer, &self.settings, receiver, frame)
            })
            .collect();
        packet::walk::<L, H>(&cuts, shared, layers, work);
        let full = self.settings.full.clamp(0.75, 1.0);
        for ((&i, cut), layers) in chosen.iter().zip(&cuts).zip(layers) {
            let receiver = &receivers[i as usize];
            let facet = cut.frame.local(receiver.facet);
            let hidden = |direction: Vec3| facet.dot(direction) <= 0.0;
            work.fragments += painting.paint(layers, self.buffer, full, hidden);
            let cells = painting.cells();
            gathered[i as usize] = self.convolve(receiver, &cut.frame, |cell| {
                (cells[cell].radiance, 1.0 - cells[cell].covered)
            });
        }
    }

    /// What each receiver gathers, and the cost of all. The same bits for any number of threads. `tick` hears of (done,
    /// all) pieces of work.
    ///
    /// # Errors
    /// Those of `tick`.
    pub fn all<E: Send>(
        &self,
        receivers: &[Receiver],
        tick: impl Fn(u64, u64) -> Result<(), E> + Sync,
    ) -> Result<(Vec<Gathered>, Work), E> {
        let done = AtomicU64::new(0);
        let pieces = receivers.len().div_ceil(PIECE) as u64;
        let mut gathered = vec![Gathered::default(); receivers.len()];
        let work = gathered
            .par_chunks_mut(PIECE)
            .zip(receivers.par_chunks(PIECE))
            .map_init(Scratch::default, |scratch, (gathered, receivers)| {
                tick(done.fetch_add(1, Ordering::Relaxed), pieces)?;
                let mut work = Work::default();
                let mut order: Vec<u32> = (0..receivers.len() as u32).collect();
                grouping::group(&mut order, receivers, WIDTH);
                for chosen in order.chunks(WIDTH) {
                    self.few(receivers, chosen, gathered, scratch, &mut work);
                }
                Ok(work)
            })
            .try_reduce(Work::default, |a, b| Ok(a + b))?;
        Ok((gathered, work))
    }

    /// The cells through the receiver's BRDF.
    #[inline(always)]
    fn convolve(
        &self,
        receiver: &Receiver,
        frame: &Frame,
        composite: impl Fn(usize) -> (Vec3, f32),
    ) -> Gathered {
        let facet = frame.local(receiver.facet);
        let to_eye = frame.local(receiver.to_eye);
        let (mut radiance, mut bent) = (Vec3::ZERO, Vec3::ZERO);
        let (mut open, mut all) = (0.0, 0.0);
        let Reflectance { specular, roughness, .. } = receiver.reflectance;
        let sharp = specular != Vec3::ZERO && roughness < SHARP;
        // Half vectors turn by half of what directions do: a cell spans half of its width.
        let cell = FRAC_PI_4 / self.buffer.resolution as f32;
        let edge = (WIDTHS * roughness * roughness + cell).cos();
        for (c, cell) in self.buffer.cells().iter().enumerate() {
            // What lies below the facet is the receiver's own surface, whatever its shading normal says.
            if facet.dot(cell.direction) <= 0.0 {
                continue;
            }
            let (mut incoming, left) = composite(c);
            if left > 0.0 {
                incoming += (self.background)(frame.world(cell.direction)) * left;
                open += left * cell.weight;
                bent += cell.direction * (left * cell.weight);
            }
            all += cell.weight;
            let reflected = |part: &Cell| {
                receiver.reflectance.brdf(Vec3::Z, to_eye, part.direction) * part.weight
            };
            let brdf: Vec3 = if sharp && (to_eye + cell.direction).normalize_or_zero().z > edge {
                self.buffer.parts(c).iter().map(reflected).sum()
            } else {
                reflected(cell)
            };
            radiance += incoming * brdf;
        }
        let open = if all > 0.0 { open / all } else { 0.0 };
        Gathered { radiance, open, unoccluded: frame.world(bent).normalize_or_zero() }
    }
}
