//! Walks from one frame to its neighbours with the map into that frame (Hašan et al. 2008, section 4.4).

use super::neighbours::{Features, compose};
use super::nine_vectors::nine_vectors;
use crate::data::{DeepFramebuffer, Geometry, PixelMaps};
use crate::node::{All, Ctx, Error, Item};
use std::sync::Arc;

/// The frames of a shot and the maps between neighbours.
#[derive(Clone, Copy)]
pub struct Maps<'a> {
    /// Surface samples of every frame; one item if all frames see the same.
    pub framebuffer: &'a All<DeepFramebuffer>,
    /// The shapes that they show.
    pub geometry: &'a Item<Geometry>,
    /// Between frame k and k + 1; not needed for frames that see the same.
    pub maps: Option<&'a All<PixelMaps>>,
}

/// The map from the frame reached into the source frame.
pub struct Mapper<'a> {
    shot: Maps<'a>,
    ctx: &'a Ctx,
    source: usize,
    /// 9-vectors of the source frame; none where no map is needed.
    features: Option<Arc<Features>>,
    /// Frame reached, and its map into the source frame; none where it sees what the source sees.
    reached: (usize, Option<Vec<u32>>),
}

impl<'a> Mapper<'a> {
    /// Stands at frame `source`.
    ///
    /// # Errors
    /// When an input cannot be had.
    pub fn new(shot: Maps<'a>, ctx: &'a Ctx, source: usize) -> Result<Self, Error> {
        let mut features = None;
        if let Some(maps) = shot.maps.filter(|maps| !maps.is_empty()) {
            let weights = maps.get(0)?.weights;
            features = Some(nine_vectors(
                ctx,
                &shot.framebuffer.broadcast(source)?,
                shot.geometry,
                weights,
            )?);
        }
        Ok(Mapper { shot, ctx, source, features, reached: (source, None) })
    }

    /// For each pixel of frame `k` the pixel of the source frame that sees the same, or `UNMAPPED`; none where every
    /// pixel is its own. Walks on from the last frame asked for if that lies between, and otherwise from the source.
    ///
    /// # Errors
    /// When an input cannot be had, or frames differ and there are no maps.
    pub fn to(&mut self, k: usize) -> Result<Option<&[u32]>, Error> {
        let reached = self.reached.0;
        let between = if k > self.source {
            (self.source..=k).contains(&reached)
        } else {
            (k..=self.source).contains(&reached)
        };
        if !between {
            self.reached = (self.source, None);
        }
        while self.reached.0 != k {
            let next = if k > self.reached.0 { self.reached.0 + 1 } else { self.reached.0 - 1 };
            self.step(next)?;
        }
        Ok(self.reached.1.as_deref())
    }

    fn step(&mut self, next: usize) -> Result<(), Error> {
        let at = self.reached.0;
        let frame = |k: usize| self.shot.framebuffer.broadcast(k);
        let (here, there) = (frame(at)?, frame(next)?);
        // Equal frames have equal maps into the source.
        if here.digest() == there.digest() {
            self.reached.0 = next;
            return Ok(());
        }
        let (Some(maps), Some(features)) = (self.shot.maps, &self.features) else {
            return Err(Error::invalid(
                "representatives serve several frames: connect `maps` from PixelMaps",
            ));
        };
        let pair = maps.broadcast(at.min(next))?;
        let step = if next > at { &pair.forward } else { &pair.backward };
        let map = match self.reached.1.take() {
            None => step.to_vec(),
            Some(onward) => {
                let target = nine_vectors(self.ctx, &there, self.shot.geometry, pair.weights)?;
                compose(&onward, step, features, &target)
                    .map_err(|e| Error::invalid(e.to_string()))?
            }
        };
        self.reached = (next, Some(map));
        Ok(())
    }
}
