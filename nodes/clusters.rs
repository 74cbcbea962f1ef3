//! Rectangular clusters of light-frame pairs by top-down splitting (Hašan et al. 2008, section 4.3.2).

use crate::data::{self, PixelMaps, Rows};
use crate::kernel::clustering::{Settings, Tensor, cluster_tensor};
use crate::kernel::history::store;
use crate::node::{All, Ctx, Error, Item, Node, Problems, Sizes};

crate::params! {
    /// Clusters the columns of the lighting tensor over lights and time, so that one representative can
    /// stand for each cluster without flicker.
    pub struct Clusters {
        /// Clusters in lights only from which the splitting starts.
        start: u32 = 100, 1..=65_536;
        /// Clusters a frame, on average, at which the splitting stops. `Representatives` takes any
        /// smaller count from the history without clustering again.
        limit: u32 = 400, 1..=65_536;
        /// Factor on the cost of time splits when they compete with light splits; above 1 they are rarer.
        time_weight: f64 = 1.0, 0.001..=1000.0;
        /// Share of pixels without a near neighbour in the next frame above which the camera cut, and
        /// no cluster reaches across.
        cut: f32 = 0.5, 0.0..=1.0;
        /// Seed of all random choices.
        seed: u64 = 1;
    }
}

crate::inputs! {
    /// Inputs of [`Clusters`].
    pub struct ClustersIn {
        /// Rows of every frame.
        rows: All<Rows>,
        /// Tells where the camera cut; without it, nowhere.
        maps: Option<All<PixelMaps>>,
    }
}

impl Node for Clusters {
    const KIND: &'static str = "Clusters";
    const VERSION: u32 = 1;
    type In = ClustersIn;
    type Out = data::Clusters;

    fn check(&self, problems: &mut Problems) {
        if self.limit < self.start {
            problems.report("limit", format!("expected at least `start`, {}, found {}", self.start, self.limit));
        }
    }

    fn memory(&self, inputs: &Sizes) -> u64 {
        inputs.bytes("rows") / 20 * 23
    }

    fn run(&self, input: ClustersIn, ctx: &Ctx) -> Result<Self::Out, Error> {
        let frames = input.rows.len();
        let first = input.rows.get(0)?;
        let (lights, rows) = (first.norm.len(), first.pixel.len());
        let tensor = Tensor::from_frames(lights, rows, frames, |k| {
            let item = input.rows.get(k)?;
            if frames > 1 && item.identity == 0 {
                return Err(Error::invalid(
                    "these virtual lights are others in every frame: light j of one frame is not light j of the \
                     next. Use GatherSamples and GatherLights for shots; PhotonLights are for single frames",
                ));
            }
            same(&item, lights, rows)?;
            Ok(Columns(item))
        })?;
        let cuts = self.cuts(&input)?;
        if !cuts.is_empty() {
            ctx.note(format!("the camera cuts at {} places of the chunk", cuts.len()));
        }
        let limit = self.limit as usize * frames;
        // A chunk of several segments starts with clusters of its own in each.
        let start = (self.start as usize).min(limit / (cuts.len() + 1)).max(1);
        let settings = Settings { start, limit, time_weight: self.time_weight, seed: self.seed, cuts: &cuts };
        let history = cluster_tensor::<Error>(&tensor, &settings, &|done, total| ctx.tick(done, total))?;
        if history.start.is_empty() {
            ctx.note(format!("none of {lights} lights reaches a sampled pixel"));
        }
        Ok(store(history, lights, frames))
    }
}

impl Clusters {
    /// Frames at which a new segment starts.
    fn cuts(&self, input: &ClustersIn) -> Result<Vec<usize>, Error> {
        let Some(maps) = &input.maps else { return Ok(Vec::new()) };
        let mut cuts = Vec::new();
        for k in 0..maps.len() {
            if maps.get(k)?.far > self.cut {
                cuts.push(k + 1);
            }
        }
        Ok(cuts)
    }
}

/// One frame's reduced columns, held while they are copied into the tensor.
struct Columns(Item<Rows>);

impl AsRef<[f32]> for Columns {
    fn as_ref(&self) -> &[f32] {
        &self.0.reduced
    }
}

fn same(item: &Rows, lights: usize, rows: usize) -> Result<(), Error> {
    if item.norm.len() == lights && item.pixel.len() == rows {
        return Ok(());
    }
    let found = format!("{} lights and {} rows", item.norm.len(), item.pixel.len());
    Err(Error::invalid(format!(
        "one frame has {lights} lights and {rows} rows, another {found}: light j must be the same light in every frame"
    )))
}
