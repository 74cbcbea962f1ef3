//! Clusters of the columns of each frame by itself: matrix row-column sampling (Hašan et al. 2007).

use crate::data::{Clusters, Rows};
use crate::kernel::clustering::{Mode, Tensor, cluster_columns};
use crate::kernel::history::{interleave, store};
use crate::node::{All, Ctx, Error, Node, Sizes};

crate::choice! {
    /// How columns are clustered.
    pub enum Method {
        /// Sampling for two thirds of the clusters, then splits: the paper's choice.
        Combined = "combined",
        /// Multi-set sampling alone.
        Sampling = "sampling",
        /// Divide and conquer alone.
        Divide = "divide",
    }
}

crate::params! {
    /// Clusters the lights of each frame by their reduced columns, as if there were no other frames: the
    /// method for stills, and over a shot the baseline that flickers.
    pub struct ColumnClusters {
        /// Number of clusters a frame.
        count: u32 = 200, 1..=65_536;
        /// How they are found.
        method: Method = Method::Combined;
        /// Seed of all random choices.
        seed: u64 = 1;
    }
}

crate::inputs! {
    /// Inputs of [`ColumnClusters`].
    pub struct ColumnClustersIn {
        /// Rows of every frame.
        rows: All<Rows>,
    }
}

impl Node for ColumnClusters {
    const KIND: &'static str = "ColumnClusters";
    const VERSION: u32 = 1;
    type In = ColumnClustersIn;
    type Out = Clusters;

    fn memory(&self, inputs: &Sizes) -> u64 {
        3 * inputs.bytes("rows") / inputs.items("rows").max(1)
    }

    fn run(&self, input: ColumnClustersIn, ctx: &Ctx) -> Result<Clusters, Error> {
        let mode = match self.method {
            Method::Combined => Mode::Combined,
            Method::Sampling => Mode::Sampling,
            Method::Divide => Mode::Divide,
        };
        let (frames, count) = (input.rows.len() as u64, u64::from(self.count));
        let mut lights = 0;
        let mut histories = Vec::new();
        for k in 0..frames {
            let rows = input.rows.get(k as usize)?;
            lights = lights.max(rows.norm.len());
            let tensor = Tensor::from_frames(rows.norm.len(), rows.pixel.len(), 1, |_| Ok::<_, Error>(&rows.reduced[..]))?;
            let tick = |done, _| ctx.tick(k * count + done, frames * count);
            // Every frame draws its own numbers, as a still would.
            histories.push(cluster_columns::<Error>(&tensor, mode, self.count as usize, self.seed.wrapping_add(k), &tick)?);
        }
        if histories.iter().all(|h| h.start.is_empty()) {
            ctx.note(format!("none of {lights} lights reaches a sampled pixel"));
        }
        Ok(store(interleave(&histories), lights, frames as usize))
    }
}
