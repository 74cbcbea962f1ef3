//! Clusters of the columns of one frame: matrix row-column sampling (Hašan et al. 2007).

use crate::data::{Clusters, Rows};
use crate::kernel::clustering::{Mode, Tensor, cluster_columns};
use crate::kernel::history::store;
use crate::node::{Ctx, Error, Item, Node};

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
    /// Clusters the lights of a single frame by their reduced columns.
    pub struct ColumnClusters {
        /// Number of clusters.
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
        /// Rows of the frame.
        rows: Item<Rows>,
    }
}

impl Node for ColumnClusters {
    const KIND: &'static str = "ColumnClusters";
    const VERSION: u32 = 1;
    type In = ColumnClustersIn;
    type Out = Clusters;

    fn run(&self, input: ColumnClustersIn, ctx: &Ctx) -> Result<Clusters, Error> {
        let rows = &input.rows;
        let (lights, height) = (rows.norm.len(), rows.pixel.len());
        let tensor = Tensor::from_frames(lights, height, 1, |_| Ok::<_, Error>(&rows.reduced[..]))?;
        let mode = match self.method {
            Method::Combined => Mode::Combined,
            Method::Sampling => Mode::Sampling,
            Method::Divide => Mode::Divide,
        };
        let tick = |done, total| ctx.tick(done, total);
        let history = cluster_columns::<Error>(&tensor, mode, self.count as usize, self.seed, &tick)?;
        Ok(store(history, lights, 1))
    }
}
