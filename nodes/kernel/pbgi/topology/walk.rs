//! Values of nodes from the leaves up, without recursion: trees may be as deep as they have leaves.

use super::{ARITY, Part, Topology};

/// What makes values.
pub trait Fold<V> {
    /// The value of a leaf.
    fn leaf(&mut self, leaf: usize) -> V;
    /// Adds the value of the next child to `value`, which holds `before` children of the same node.
    fn merge(&mut self, value: &mut V, child: &V, before: u32);
    /// Called when all children of an inner node are in.
    fn close(&mut self, node: usize, value: &mut V);
    /// The value of an inner node that need not be walked into, as the merged children give it.
    fn given(&mut self, _node: usize) -> Option<V> {
        None
    }
}

/// What is left to do of a walk.
enum Task<N> {
    /// Make the value of a node.
    Open(N),
    /// Add the last value to the one before it, which holds so many children.
    Merge(u32),
    /// The last value is that of this inner node.
    Close(usize),
}

/// Folds the subtree of `root`, children in their order and each node after its children. Gives the value of the root, none for
/// a tree without nodes, and the greatest number of values that lived at once.
pub fn fold<T: Topology, V>(
    topology: &T,
    root: Option<T::Node>,
    with: &mut impl Fold<V>,
) -> (Option<V>, usize) {
    let mut tasks: Vec<Task<T::Node>> = root.map(Task::Open).into_iter().collect();
    let (mut values, mut peak) = (Vec::with_capacity(64), 0);
    while let Some(task) = tasks.pop() {
        match task {
            Task::Open(node) => match topology.part(node) {
                Part::Leaf(k) => values.push(with.leaf(k)),
                Part::Inner(i) => {
                    tasks.push(Task::Close(i));
                    match with.given(i) {
                        Some(value) => values.push(value),
                        None => open(topology, node, &mut tasks),
                    }
                }
            },
            Task::Merge(before) => {
                peak = peak.max(values.len());
                if let [.., value, child] = &mut values[..] {
                    with.merge(value, child, before);
                    values.pop();
                }
            }
            Task::Close(i) => {
                if let Some(value) = values.last_mut() {
                    with.close(i, value);
                }
            }
        }
    }
    (values.pop(), peak.max(usize::from(root.is_some())))
}

/// Plans to open the children of a node, the first one next, and to merge each further one.
fn open<T: Topology>(topology: &T, node: T::Node, tasks: &mut Vec<Task<T::Node>>) {
    let (mut children, mut count) = ([node; ARITY], 0);
    topology.children(node, |child| {
        children[count] = child;
        count += 1;
    });
    for (k, &child) in children[..count].iter().enumerate().rev() {
        if k > 0 {
            tasks.push(Task::Merge(k as u32));
        }
        tasks.push(Task::Open(child));
    }
}
