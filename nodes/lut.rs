//! The table of node data vectors: k-means over a tree of some surfels (Buchholz and Boubekeur 2012, section 3.1).

use crate::data::{self, Array, RadiantSurfels};
use crate::kernel::pbgi::learning::of_nodes;
use crate::kernel::pbgi::lut::{KMeans, Lut as Table, Seeding, Weighting, balance, balanced};
use crate::kernel::pbgi::stored::{Recipe, Shape, build};
use crate::kernel::pbgi::stream::{Average, dimensions};
use crate::kernel::pbgi::tree::looks::Format;
use crate::node::{All, Ctx, Error, Item, Node};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Nodes that are learned from for each entry. With more of them the many small nodes take entries from the few
/// large ones, which are seen from farther and by more receivers.
const VECTORS: usize = 4;

crate::choice! {
    /// What a table is learned from.
    pub enum Source {
        /// Nodes of the tree, the larger the likelier.
        Nodes = "nodes",
        /// All nodes of a tree of some of the surfels (the paper).
        Surfels = "surfels",
    }
}

crate::params! {
    /// Finds representative node data vectors by k-means. It learns from nodes of the tree itself, most
    /// from large ones, or as the paper does from a tree of some of the surfels; of one moment, or of all
    /// frames. Vectors that are nearly black are left out, and an entry of zeros stands for them.
    pub struct Lut {
        /// Number of entries; one more where there are nearly black vectors, fewer where there are not so
        /// many distinct vectors.
        entries: u32 = 10_000, 1..=1_048_576;
        /// What vectors are learned from.
        from: Source = Source::Nodes;
        /// Share of the surfels that are drawn, where it learns from surfels. In the paper 0.1; at 0.001
        /// rare colours are missed.
        subset: f64 = 0.1, 0.000001..=1.0;
        /// Rounds of Lloyd's algorithm; 10 to 20 in the paper. 0 keeps the vectors that were drawn at
        /// random, as in Figure 4.
        iterations: u32 = 10, 0..=1000;
        /// Where entries start.
        seeding: Seeding = Seeding::Random;
        /// How much each vector counts.
        weighting: Weighting = Weighting::None;
        /// Shape of the tree.
        shape: Shape = Shape::Binary;
        /// How children become their parent; as in the tree that the table is for.
        average: Average = Average::Area;
        /// Bands of the harmonics; 3 in the paper.
        bands: u32 = 3, 1..=5;
        /// Seed of all draws.
        seed: u64 = 1;
    }
}

crate::inputs! {
    /// Inputs of [`Lut`].
    pub struct LutIn {
        /// Shaded surfels of one moment: each frame has a table of its own.
        surfels: Option<Item<RadiantSurfels>>,
        /// Shaded surfels of all frames in place of those: one table for all.
        shot: Option<All<RadiantSurfels>>,
    }
}

impl Node for Lut {
    const KIND: &'static str = "Lut";
    const VERSION: u32 = 2;
    type In = LutIn;
    type Out = data::Lut;

    fn run(&self, input: LutIn, ctx: &Ctx) -> Result<data::Lut, Error> {
        ctx.tick(0, 1)?;
        let shot = match (input.surfels, input.shot) {
            (Some(surfels), None) => All::one(surfels),
            (None, Some(shot)) => shot,
            (None, None) => return Err(Error::invalid("neither `surfels` nor `shot` is given")),
            _ => return Err(Error::invalid("both `surfels` and `shot` are given: one is enough")),
        };
        let mut vectors = Vec::new();
        for k in 0..shot.len() {
            vectors.extend(self.vectors(&*shot.get(k)?, shot.len())?);
        }
        let dims = dimensions(self.bands);
        let settings = KMeans {
            entries: self.entries,
            iterations: self.iterations,
            seeding: self.seeding,
            weighting: self.weighting,
            seed: self.seed,
            ..KMeans::default()
        };
        let balance = balance(&vectors, dims);
        let even = balanced(&vectors, dims, balance);
        let tick = |done, total| ctx.tick(done, total);
        let table = Table::build(&even, dims, &settings, &tick)?;
        let entries = balanced(&table.entries, dims, 1.0 / balance).into_owned();
        let rows = entries.len() / dims;
        ctx.note(format!("{rows} entries from {} vectors", vectors.len() / dims));
        Ok(data::Lut { entries: Array::shaped(entries, &[rows, dims]), bands: self.bands, balance })
    }
}

impl Lut {
    /// What is learned from one of so many frames.
    fn vectors(&self, all: &RadiantSurfels, frames: usize) -> Result<Vec<f32>, Error> {
        if self.from == Source::Nodes {
            let count = (VECTORS * self.entries as usize).div_ceil(frames);
            return Ok(of_nodes(all, self.shape, self.average, self.bands, count));
        }
        let count = all.position.len();
        let wanted = (count as f64 * self.subset / frames as f64).ceil() as usize;
        let drawn = self.drawn(count, wanted.clamp(1, count.max(1)));
        let some = RadiantSurfels {
            position: drawn.iter().map(|&i| all.position[i]).collect(),
            normal: drawn.iter().map(|&i| all.normal[i]).collect(),
            radiance: drawn.iter().map(|&i| all.radiance[i]).collect(),
            area: drawn.iter().map(|&i| all.area[i]).collect(),
            radius: drawn.iter().map(|&i| all.radius[i]).collect(),
        };
        let recipe = Recipe {
            shape: self.shape,
            average: self.average,
            format: Format::A,
            bands: self.bands,
        };
        Ok(build(&some, recipe, None)?.0.rows.to_vec())
    }

    /// `wanted` of `count` surfels, each with the probability that exactly so many are drawn at the end.
    fn drawn(&self, count: usize, wanted: usize) -> Vec<usize> {
        let mut random = Pcg64Mcg::seed_from_u64(self.seed);
        let mut left = wanted;
        let draw = |&i: &usize| {
            let chosen = random.random::<f64>() * ((count - i) as f64) < left as f64;
            left -= usize::from(chosen);
            chosen
        };
        (0..count).filter(draw).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_as_wanted_are_drawn_all_over() {
        let drawn = Lut::default().drawn(10_000, 1000);
        assert_eq!((drawn.len(), Lut::default().drawn(7, 7).len()), (1000, 7));
        assert!(drawn.windows(2).all(|w| w[0] < w[1]));
        let early = drawn.iter().filter(|&&i| i < 5000).count();
        assert!((430..570).contains(&early), "{early}");
    }
}
