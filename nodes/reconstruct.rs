//! Reconstruction: representatives, scaled and mapped to the frames they serve
//! (Hašan et al. 2008, section 4.5).
//!
//! Mapping is linear, so for each representative frame the scaled columns are summed first, one sum
//! for each frame they serve, and each sum is mapped once. No column outlives its packet of pixels.

use crate::data::{Array, DeepFramebuffer, Geometry, Image, Lights, Materials, NONE, PixelMaps, Poses, Representatives};
use crate::kernel::checkpoint::Checkpoint;
use crate::kernel::light_tensor::{LightTensor, RayTensor};
use crate::kernel::mapper::{Mapper, Maps};
use crate::kernel::receivers::Receivers;
use crate::kernel::scaled_sums::Waiting;
use crate::kernel::stage::Stage;
use crate::kernel::visibility::{Blocker, Ends};
use crate::node::{All, Ctx, Error, Item, Node, Sequence, Sizes};
use glam::Vec3;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

/// Receivers whose sums for all frames served fit the second-level cache.
const BLOCK: usize = 8 * Ends::CAPACITY;

/// Pixels that are mapped as one piece of work.
const CHUNK: usize = 4096;

crate::params! {
    /// Renders one column for each representative and adds it, scaled and mapped, to every frame it
    /// serves. Emitted light and background are added as the framebuffers have them.
    pub struct Reconstruct {
    }
}

crate::inputs! {
    /// Inputs of [`Reconstruct`].
    pub struct ReconstructIn {
        /// What to render, and the reconstruction matrix.
        representatives: Item<Representatives>,
        /// Surface samples of every frame.
        framebuffer: All<DeepFramebuffer>,
        /// Lights of every frame.
        lights: All<Lights>,
        /// Shapes that cast shadows.
        geometry: Item<Geometry>,
        /// Their materials.
        materials: Item<Materials>,
        /// Where they are in every frame.
        poses: All<Poses>,
        /// Maps between neighbouring frames; not needed for a single frame.
        maps: Option<All<PixelMaps>>,
    }
}

impl Node for Reconstruct {
    const KIND: &'static str = "Reconstruct";
    const VERSION: u32 = 1;
    type In = ReconstructIn;
    type Out = Sequence<Image>;
    // The columns of a small count are among those of a larger one, where representatives nest.
    const SHARES: Option<&'static str> = Some("representatives");

    fn memory(&self, inputs: &Sizes) -> u64 {
        // A pixel takes 80 bytes in a framebuffer and 12 in each of the two images of a frame.
        inputs.bytes("framebuffer") / 80 * 24 + 8 * inputs.bytes("geometry")
    }

    fn run(&self, input: ReconstructIn, ctx: &Ctx) -> Result<Sequence<Image>, Error> {
        let mut outputs = self.run_together(vec![(input, ctx)])?;
        outputs.pop().ok_or_else(|| Error::invalid("a pass gave nothing"))
    }

    fn run_together(&self, runs: Vec<(ReconstructIn, &Ctx)>) -> Result<Vec<Sequence<Image>>, Error> {
        let mut shots = Vec::with_capacity(runs.len());
        for (input, ctx) in &runs {
            shots.push(Shot::begin(input, ctx)?);
        }
        let Some((input, _)) = runs.first() else { return Ok(Vec::new()) };
        let frames = shots.iter().map(|shot| shot.images.len()).max().unwrap_or(0);
        for source in 0..frames {
            Pass::new(input, &shots, source).run(&mut shots)?;
        }
        let shape = input.framebuffer.get(0)?.triangle.shape().to_vec();
        let image = |radiance| Image { radiance: Array::shaped(radiance, &shape) };
        let sequence = |shot: Shot<'_>| Sequence {
            chunk: shot.images.len(),
            items: shot.images.into_iter().map(image).collect(),
        };
        Ok(shots.into_iter().map(sequence).collect())
    }
}

/// One reconstruction under way: what it renders, and its images so far.
struct Shot<'a> {
    representatives: &'a Representatives,
    ctx: &'a Ctx,
    checkpoint: Checkpoint,
    images: Vec<Vec<Vec3>>,
}

impl<'a> Shot<'a> {
    /// Starts with what the framebuffers have, or where an interrupted run left off.
    fn begin(input: &'a ReconstructIn, ctx: &'a Ctx) -> Result<Self, Error> {
        let representatives = &*input.representatives;
        let frames = representatives.count as usize;
        // One framebuffer serves a shot in which only lights change.
        let found = input.framebuffer.len();
        if found != frames && found != 1 {
            return Err(Error::invalid(format!("representatives of {frames} frames, framebuffers of {found}")));
        }
        let first = input.framebuffer.get(0)?;
        let mut images = Vec::with_capacity(frames);
        for k in 0..frames {
            let framebuffer = input.framebuffer.broadcast(k)?;
            if framebuffer.triangle.shape() != first.triangle.shape() {
                return Err(Error::invalid("the framebuffers of the shot have different sizes"));
            }
            images.push(framebuffer.emitted.to_vec());
            let columns = served_from(representatives, k).len();
            let receivers = framebuffer.triangle.iter().filter(|&&t| t != NONE).count();
            ctx.evaluated(columns as u64 * receivers as u64);
        }
        let checkpoint = Checkpoint::resume(ctx, &mut images);
        Ok(Shot { representatives, ctx, checkpoint, images })
    }

    /// Its representatives in frame `source`; none where a checkpoint has them already.
    fn columns(&self, source: usize) -> Range<usize> {
        let range = served_from(self.representatives, source);
        if source < self.checkpoint.next() { range.end..range.end } else { range }
    }
}

/// The representatives whose column lies in frame `source`; they are sorted by frame.
fn served_from(representatives: &Representatives, source: usize) -> Range<usize> {
    let pair = &representatives.pair;
    pair.partition_point(|p| (p[1] as usize) < source)..pair.partition_point(|p| p[1] as usize <= source)
}

/// All representatives that any of the reconstructions has in one frame. Each column is rendered once,
/// however many of them use it.
struct Pass<'a> {
    input: &'a ReconstructIn,
    source: usize,
    /// Each light with who uses its column: reconstruction and number among its representatives.
    columns: Vec<(u32, Vec<(usize, usize)>)>,
    members: Vec<Member<'a>>,
}

/// One reconstruction's part of a pass.
struct Member<'a> {
    representatives: &'a Representatives,
    ctx: &'a Ctx,
    /// Frames that any of its representatives in this pass serves.
    served: Range<usize>,
    /// Its representatives up to this pass.
    before: u64,
}

impl<'a> Pass<'a> {
    fn new(input: &'a ReconstructIn, shots: &[Shot<'a>], source: usize) -> Self {
        let mut columns: BTreeMap<u32, Vec<(usize, usize)>> = BTreeMap::new();
        let mut members = Vec::with_capacity(shots.len());
        for (m, shot) in shots.iter().enumerate() {
            let range = shot.columns(source);
            range.clone().for_each(|r| columns.entry(shot.representatives.pair[r][0]).or_default().push((m, r)));
            let frames = &shot.representatives.frames[range.clone()];
            let start = frames.iter().map(|f| f[0]).min().unwrap_or(0) as usize;
            let end = frames.iter().map(|f| f[1]).max().unwrap_or(0) as usize;
            members.push(Member {
                representatives: shot.representatives,
                ctx: shot.ctx,
                served: start..end,
                before: range.start as u64,
            });
        }
        Pass { input, source, columns: columns.into_iter().collect(), members }
    }

    fn run(&self, shots: &mut [Shot<'_>]) -> Result<(), Error> {
        let (Some((last, _)), Some(first)) = (self.columns.last(), self.members.first()) else { return Ok(()) };
        let input = self.input;
        let framebuffer = input.framebuffer.broadcast(self.source)?;
        let poses = input.poses.broadcast(self.source)?;
        let lights = input.lights.broadcast(self.source)?;
        let stage = Stage::of(first.ctx, &input.geometry, &input.materials, &poses)?;
        let tensor = RayTensor::new(&stage, &lights);
        if *last as usize >= tensor.lights() {
            return Err(Error::invalid(format!("representative light {last} of {}", tensor.lights())));
        }
        let receivers = Receivers::of(&framebuffer);
        for member in &self.members {
            member.ctx.pass_evaluated(self.columns.len() as u64 * receivers.samples.len() as u64);
        }
        // The sums of a block for all members together fit the cache as those of one do.
        let block = (BLOCK / self.members.len()).next_power_of_two().max(Ends::CAPACITY);
        let sums = self.sum_columns(&tensor, &receivers, block)?;
        let place = receivers.places(framebuffer.triangle.len());
        let shot = Maps { framebuffer: &input.framebuffer, geometry: &input.geometry, maps: input.maps.as_ref() };
        let mut mapper = Mapper::new(shot, first.ctx, self.source)?;
        let active = || self.members.iter().map(|m| m.served.clone()).filter(|served| !served.is_empty());
        let start = active().map(|served| served.start).min().unwrap_or(0);
        let end = active().map(|served| served.end).max().unwrap_or(0);
        let here = self.source.clamp(start, end);
        let mut sum = vec![Vec3::ZERO; receivers.samples.len()];
        // Outward in both directions, so that each map is composed from the one before.
        for k in (here..end).chain((start..here).rev()) {
            let map = mapper.to(k)?;
            for (m, member) in self.members.iter().enumerate().filter(|(_, member)| member.served.contains(&k)) {
                let frame = k - member.served.start;
                // One after the other, since maps jump about in them.
                sum.par_chunks_mut(block).zip(&sums).for_each(|(sum, sums)| {
                    sum.copy_from_slice(&sums[m][frame * sum.len()..][..sum.len()]);
                });
                let target = &mut shots[m].images[k];
                target.par_iter_mut().enumerate().with_min_len(CHUNK).for_each(|(pixel, target)| {
                    let source = map.map_or(pixel as u32, |map| map[pixel]);
                    // Pixels without a source or a receiver are numbers beyond all others.
                    let at = place.get(source as usize).copied().unwrap_or(NONE);
                    *target += sum.get(at as usize).copied().unwrap_or(Vec3::ZERO);
                });
            }
        }
        for shot in shots {
            let range = shot.columns(self.source);
            if !range.is_empty() {
                shot.checkpoint.save(self.source + 1, &shot.images)?;
                shot.ctx.tick(range.end as u64, shot.representatives.pair.len() as u64)?;
            }
        }
        Ok(())
    }

    /// For each block of receivers and each member, `[frame served][receiver]`: the sum of its columns with their
    /// weights in that frame.
    fn sum_columns(&self, tensor: &RayTensor<'_>, receivers: &Receivers, block: usize) -> Result<Vec<Vec<Vec<Vec3>>>, Error> {
        let (blocks, finished) = (receivers.samples.len().div_ceil(block).max(1) as u64, AtomicU64::new(0));
        receivers
            .samples
            .par_chunks(block)
            .map(|block| {
                let zeros = |member: &Member<'_>| vec![Vec3::ZERO; member.served.len() * block.len()];
                let mut sums: Vec<Vec<Vec3>> = self.members.iter().map(zeros).collect();
                let mut waiting = Waiting::new();
                let mut blockers = vec![Blocker::default(); self.columns.len()];
                for (t, receivers) in block.chunks(Ends::CAPACITY).enumerate() {
                    let tile = tensor.tile(receivers);
                    for ((light, users), blocker) in self.columns.iter().zip(&mut blockers) {
                        if tensor.column(*light as usize, &tile, blocker, waiting.room()) == 0 {
                            continue;
                        }
                        for &(m, r) in users {
                            let (from, weights) = self.members[m].weights(r);
                            waiting.count_in(m, from, weights);
                        }
                        if waiting.keep() {
                            waiting.add(&mut sums, block.len(), t * Ends::CAPACITY);
                        }
                    }
                    waiting.add(&mut sums, block.len(), t * Ends::CAPACITY);
                }
                let finished = finished.fetch_add(1, Ordering::Relaxed) + 1;
                for member in self.members.iter().filter(|m| !m.served.is_empty()) {
                    let columns = served_from(member.representatives, self.source).len() as u64;
                    let total = member.representatives.pair.len() as u64;
                    member.ctx.tick(member.before + columns * finished / blocks, total)?;
                }
                Ok(sums)
            })
            .collect()
    }
}

impl Member<'_> {
    /// The first of the served frames that representative `r` serves, and its weights in that and those that follow.
    fn weights(&self, r: usize) -> (usize, &[Vec3]) {
        let representatives = self.representatives;
        let [from, to] = representatives.frames[r].map(|f| f as usize);
        let weights = &representatives.weight[representatives.first_weight[r] as usize..][..to - from];
        (from - self.served.start, weights)
    }
}
