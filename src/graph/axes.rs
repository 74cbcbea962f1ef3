//! Sequences as types: over what a node runs, and over what its output goes.

use lightloom_nodes::node::Cardinality;

/// What the items of an output stand for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Axis {
    /// One item for the whole graph.
    Single,
    /// One item a frame.
    Frames,
    /// One item for each frame and its next one, within a chunk.
    Pairs,
    /// One item a chunk of frames.
    Chunks,
}

impl Axis {
    /// `one item a frame`, for messages.
    pub fn told(self) -> &'static str {
        match self {
            Axis::Single => "a single item",
            Axis::Frames => "one item a frame",
            Axis::Pairs => "one item a pair of frames",
            Axis::Chunks => "one item a chunk",
        }
    }

    /// Its word in drawings and reports.
    pub fn word(self) -> &'static str {
        match self {
            Axis::Single => "single",
            Axis::Frames => "frames",
            Axis::Pairs => "pairs",
            Axis::Chunks => "chunks",
        }
    }
}

/// Over what a node runs, and what it gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Axes {
    /// One run for each of these.
    pub runs: Axis,
    /// One item of the output for each of these.
    pub axis: Axis,
}

impl Axes {
    /// Whether the node starts the sequence of the graph.
    pub fn starts_sequence(self) -> bool {
        self.runs == Axis::Single && self.axis == Axis::Frames
    }
}

/// One node bound to a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bound {
    /// What the port takes.
    pub cardinality: Cardinality,
    /// What the node gives.
    pub axis: Axis,
}

/// Why the inputs do not go together; the numbers are places in the list given to [`infer`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Two inputs over which the node would have to run go over frames and over pairs.
    Mixed(usize, usize),
    /// The first is a whole sequence, so that the node runs once a chunk; the second is not one a chunk.
    BesideAll(usize, usize),
    /// A window over something else than frames.
    NoFrames(usize),
    /// A whole sequence was asked of something that has one item a chunk.
    WholeOfChunks(usize),
    /// A node that gives a sequence would run many times.
    SequenceOfSequences(usize),
}

/// Finds the axes of a node from its inputs; `sequence` tells whether its type gives a sequence.
///
/// # Errors
/// The first pair of inputs that do not go together.
pub fn infer(sequence: bool, takes_all: bool, inputs: &[Bound]) -> Result<Axes, Fault> {
    use Cardinality::{All, OptionalAll, Window};
    let mut whole = None;
    let mut lifted: Option<(usize, Axis)> = None;
    for (i, input) in inputs.iter().enumerate() {
        let over = match (input.cardinality, input.axis) {
            (All | OptionalAll, Axis::Chunks) => return Err(Fault::WholeOfChunks(i)),
            (All | OptionalAll, Axis::Single) => continue,
            (All | OptionalAll, _) => {
                whole = whole.or(Some(i));
                continue;
            }
            (Window, Axis::Frames) => Axis::Pairs,
            (Window, _) => return Err(Fault::NoFrames(i)),
            (_, Axis::Single) => continue,
            (_, axis) => axis,
        };
        lifted = match lifted {
            // The frames and pairs of a chunk share what there is one of a chunk.
            None | Some((_, Axis::Chunks)) => Some((i, over)),
            Some((_, axis)) if axis == over || over == Axis::Chunks => lifted,
            Some((first, _)) => return Err(Fault::Mixed(first, i)),
        };
    }
    match (whole, lifted) {
        (Some(all), Some((i, axis))) if axis != Axis::Chunks => Err(Fault::BesideAll(all, i)),
        (Some(_), _) => Ok(Axes {
            runs: Axis::Chunks,
            axis: if sequence { Axis::Frames } else { Axis::Chunks },
        }),
        (None, Some((i, _))) if sequence => Err(Fault::SequenceOfSequences(i)),
        (None, Some((_, axis))) => Ok(Axes { runs: axis, axis }),
        (None, None) if sequence && !takes_all => {
            Ok(Axes { runs: Axis::Single, axis: Axis::Frames })
        }
        (None, None) => Ok(Axes { runs: Axis::Single, axis: Axis::Single }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Axis::{Chunks, Frames, Pairs, Single};
    use Cardinality::{All, Many, One, Optional, OptionalAll, Window};

    fn go(sequence: bool, inputs: &[(Cardinality, Axis)]) -> Result<(Axis, Axis), Fault> {
        let takes_all = inputs.iter().any(|(c, _)| matches!(c, All | OptionalAll));
        let bound: Vec<Bound> =
            inputs.iter().map(|&(cardinality, axis)| Bound { cardinality, axis }).collect();
        infer(sequence, takes_all, &bound).map(|a| (a.runs, a.axis))
    }

    #[test]
    fn rules() {
        assert_eq!(go(true, &[]), Ok((Single, Frames)));
        assert_eq!(go(false, &[]), Ok((Single, Single)));
        assert_eq!(
            go(false, &[(One, Single), (Many, Frames), (Optional, Frames)]),
            Ok((Frames, Frames))
        );
        assert_eq!(go(false, &[(One, Pairs), (One, Single)]), Ok((Pairs, Pairs)));
        assert_eq!(go(false, &[(One, Chunks)]), Ok((Chunks, Chunks)));
        assert_eq!(go(false, &[(Window, Frames), (One, Pairs)]), Ok((Pairs, Pairs)));
        assert_eq!(
            go(false, &[(All, Frames), (OptionalAll, Pairs), (One, Chunks), (One, Single)]),
            Ok((Chunks, Chunks))
        );
        assert_eq!(go(true, &[(All, Frames), (One, Single)]), Ok((Chunks, Frames)));
        assert_eq!(go(true, &[(All, Single)]), Ok((Single, Single)));
        assert_eq!(go(false, &[(All, Single), (One, Frames)]), Ok((Frames, Frames)));
        assert_eq!(go(false, &[(One, Frames), (One, Chunks)]), Ok((Frames, Frames)));
        assert_eq!(go(false, &[(Optional, Chunks), (Window, Frames)]), Ok((Pairs, Pairs)));
    }

    #[test]
    fn faults() {
        assert_eq!(
            go(false, &[(One, Chunks), (One, Frames), (One, Pairs)]),
            Err(Fault::Mixed(1, 2))
        );
        assert_eq!(go(false, &[(Window, Frames), (One, Frames)]), Err(Fault::Mixed(0, 1)));
        assert_eq!(go(false, &[(Many, Frames), (Many, Pairs)]), Err(Fault::Mixed(0, 1)));
        assert_eq!(go(true, &[(One, Frames), (All, Frames)]), Err(Fault::BesideAll(1, 0)));
        assert_eq!(go(false, &[(Window, Frames), (All, Frames)]), Err(Fault::BesideAll(1, 0)));
        assert_eq!(go(false, &[(Window, Single)]), Err(Fault::NoFrames(0)));
        assert_eq!(go(false, &[(Window, Pairs)]), Err(Fault::NoFrames(0)));
        assert_eq!(go(false, &[(All, Chunks)]), Err(Fault::WholeOfChunks(0)));
        assert_eq!(go(true, &[(One, Frames)]), Err(Fault::SequenceOfSequences(0)));
    }
}
