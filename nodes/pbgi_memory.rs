//! What a tree takes in memory (Buchholz and Boubekeur 2012, Tables 1 and 2).

use crate::data::{self, PbgiTree};
use crate::kernel::pbgi::memory::{OCTREE_LINKS, in_truth, of_paper};
use crate::kernel::pbgi::stream::dimensions;
use crate::kernel::pbgi::tree::looks::Format;
use crate::node::{Ctx, Error, Item, Node};

crate::params! {
    /// Memory of a tree in megabytes of 10^6 bytes. The paper's count has as many inner nodes as
    /// surfels, vectors of three colours, and no table; the true count has everything that is stored.
    pub struct PbgiMemory {}
}

crate::inputs! {
    /// Inputs of [`PbgiMemory`].
    pub struct PbgiMemoryIn {
        /// The tree.
        tree: Item<PbgiTree>,
    }
}

impl Node for PbgiMemory {
    const KIND: &'static str = "PbgiMemory";
    const VERSION: u32 = 1;
    type In = PbgiMemoryIn;
    type Out = data::PbgiMemory;

    fn run(&self, input: PbgiMemoryIn, _: &Ctx) -> Result<data::PbgiMemory, Error> {
        let tree = &input.tree;
        let format = [Format::A, Format::B, Format::C][usize::from(tree.format.min(2))];
        let quantized = !tree.indices.is_empty();
        let entries = (tree.rows.len() / dimensions(tree.bands)) as u64;
        let inner = tree.areas.len().max(tree.coarse_areas.len()) as u64;
        let links = if tree.counts.is_empty() { 0 } else { OCTREE_LINKS };
        let leaves = u64::from(tree.leaves);
        let paper = of_paper(leaves, tree.bands, entries, format);
        let truth = |format| in_truth(leaves, inner, links, tree.bands, entries, format);
        let full = truth(Format::A).full;
        let stored = if quantized { truth(format).quantized } else { truth(format).full };
        Ok(data::PbgiMemory {
            paper_vectors: paper.vectors * 1e-6,
            paper_indices: paper.indices * 1e-6,
            paper_full: paper.full * 1e-6,
            paper_quantized: paper.quantized * 1e-6,
            paper_ratio: paper.full / paper.quantized,
            full: full * 1e-6,
            stored: stored * 1e-6,
            ratio: full / stored,
        })
    }
}
