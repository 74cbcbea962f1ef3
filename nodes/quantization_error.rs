//! How much a table loses (Buchholz and Boubekeur 2012, Figure 4).

use crate::data::{self, Lut, PbgiTree};
use crate::kernel::pbgi::lut::errors;
use crate::kernel::pbgi::stream::dimensions;
use crate::node::{Ctx, Error, Item, Node};

crate::params! {
    /// The distance of each vector of an unquantized tree from the nearest entry of a table.
    pub struct QuantizationError {}
}

crate::inputs! {
    /// Inputs of [`QuantizationError`].
    pub struct QuantizationErrorIn {
        /// A tree with vectors of its own.
        tree: Item<PbgiTree>,
        /// The table.
        lut: Item<Lut>,
    }
}

impl Node for QuantizationError {
    const KIND: &'static str = "QuantizationError";
    const VERSION: u32 = 2;
    type In = QuantizationErrorIn;
    type Out = data::QuantizationError;

    fn run(&self, input: QuantizationErrorIn, ctx: &Ctx) -> Result<Self::Out, Error> {
        ctx.tick(0, 1)?;
        let (tree, lut) = (&input.tree, &input.lut);
        if !tree.indices.is_empty() {
            return Err(Error::invalid("the tree is quantized: its vectors are those of a table"));
        }
        if tree.bands != lut.bands {
            return Err(Error::invalid(format!(
                "the tree has {} bands and the table {}",
                tree.bands, lut.bands
            )));
        }
        let found = errors(&tree.rows, &lut.entries, dimensions(tree.bands), lut.balance)?;
        Ok(data::QuantizationError { mean_l1: found.l1, mean_l2: found.l2, worst_l2: found.largest })
    }
}
