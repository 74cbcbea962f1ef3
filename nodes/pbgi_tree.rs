//! The point hierarchy, with vectors or quantized (Buchholz and Boubekeur 2012, sections 3.2 and 3.3).

use crate::data::{self, Lut, RadiantSurfels};
use crate::kernel::pbgi::stored::{Recipe, Shape, build};
use crate::kernel::pbgi::stream::Average;
use crate::kernel::pbgi::tree::looks::Format;
use crate::node::{Ctx, Error, Item, Node, Sizes};

crate::params! {
    /// A tree over shaded surfels, one a leaf. Each inner node has a vector of spherical harmonics: what
    /// it sends in each colour, and how much of its area faces each direction. With a table, each has the
    /// place of the nearest entry instead, and the whole unquantized tree never exists.
    pub struct PbgiTree {
        /// Its shape.
        shape: Shape = Shape::Binary;
        /// How children become their parent.
        average: Average = Average::Area;
        /// How leaves are stored (Table 2).
        format: Format = Format::A;
        /// Bands of the harmonics; 3 in the paper. Those of the table where there is one.
        bands: u32 = 3, 1..=5;
    }
}

crate::inputs! {
    /// Inputs of [`PbgiTree`].
    pub struct PbgiTreeIn {
        /// Shaded surfels.
        surfels: Item<RadiantSurfels>,
        /// A table to quantize with.
        lut: Option<Item<Lut>>,
    }
}

impl Node for PbgiTree {
    const KIND: &'static str = "PbgiTree";
    const VERSION: u32 = 2;
    type In = PbgiTreeIn;
    type Out = data::PbgiTree;

    fn memory(&self, inputs: &Sizes) -> u64 {
        // A surfel of 44 bytes, what sorting and storing it takes, and its inner node's vector or place.
        let each = if inputs.items("lut") > 0 { 4 } else { 16 * self.bands * self.bands };
        inputs.bytes("surfels") / 44 * (90 + u64::from(each))
    }

    fn run(&self, input: PbgiTreeIn, ctx: &Ctx) -> Result<data::PbgiTree, Error> {
        ctx.tick(0, 1)?;
        let recipe = Recipe {
            shape: self.shape,
            average: self.average,
            format: self.format,
            bands: self.bands,
        };
        let (tree, account) = build(&input.surfels, recipe, input.lut.as_deref())?;
        ctx.note(format!("at most {} vectors lived at once", account.live));
        let losses = account.losses;
        if losses.saturated + losses.invalid > 0 {
            ctx.note(format!(
                "{} numbers were too large for a leaf and {} were none",
                losses.saturated, losses.invalid
            ));
        }
        Ok(tree)
    }
}
