//! The table of node data vectors: k-means over a tree of some surfels (Buchholz and Boubekeur 2012, section 3.1).

use crate::data::{self, Array, RadiantSurfels};
use crate::kernel::pbgi::lut::{KMeans, Lut as Table, Seeding, Weighting};
use crate::kernel::pbgi::stored::{Recipe, Shape, build};
use crate::kernel::pbgi::stream::Average;
use crate::kernel::pbgi::tree::looks::Format;
use crate::node::{Ctx, Error, Item, Node};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

crate::params! {
    /// Finds representative node data vectors: draws some of the surfels, builds a tree of them, and
    /// clusters its vectors by k-means. Vectors that are nearly black are left out, and an entry of zeros
    /// stands for them.
    pub struct Lut {
        /// Number of entries; one more where there are nearly black vectors, fewer where there are not so
        /// many distinct vectors.
        entries: u32 = 10_000, 1..=1_048_576;
        /// Share of the surfels that are drawn. In the paper 0.1; at 0.001 rare colours are missed.
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
        /// Shaded surfels.
        surfels: Item<RadiantSurfels>,
    }
}

impl Node for Lut {
    const KIND: &'static str = "Lut";
    const VERSION: u32 = 1;
    type In = LutIn;
    type Out = data::Lut;

    fn run(&self, input: LutIn, ctx: &Ctx) -> Result<data::Lut, Error> {
        ctx.tick(0, 1)?;
        let all = &input.surfels;
        let count = all.position.len();
        let wanted = ((count as f64 * self.subset).ceil() as usize).clamp(1, count.max(1));
        let drawn = self.drawn(count, wanted);
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
        let (tree, _) = build(&some, recipe, None)?;
        let dims = tree.rows.shape().get(1).copied().unwrap_or(1);
        let settings = KMeans {
            entries: self.entries,
            iterations: self.iterations,
            seeding: self.seeding,
            weighting: self.weighting,
            seed: self.seed,
            ..KMeans::default()
        };
        let table = Table::build(&tree.rows, dims, &settings, &|done, total| ctx.tick(done, total))?;
        ctx.note(format!(
            "{} entries from {} vectors of {wanted} surfels",
            table.entries.len() / dims,
            tree.rows.len() / dims
        ));
        let rows = table.entries.len() / dims;
        let entries = Array::shaped(table.entries, &[rows, dims]);
        Ok(data::Lut { entries, bands: self.bands })
    }
}

impl Lut {
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
