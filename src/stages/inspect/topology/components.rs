//! Which triangles hang together, while a stream of them is seen slab by slab.

/// Disjoint sets of numbers from 0 on, as trees of parents.
#[derive(Default)]
pub(super) struct Sets {
    parents: Vec<u32>,
}

impl Sets {
    /// Forgets all sets, and begins with so many, of one number each.
    pub(super) fn reset(&mut self, count: u32) {
        self.parents.clear();
        self.parents.extend(0..count);
    }

    /// Adds a set of one number, the next one.
    #[inline]
    pub(super) fn add(&mut self) {
        self.parents.push(self.parents.len() as u32);
    }

    /// The number that stands for the set of `number`: the least of it.
    #[inline]
    pub(super) fn find(&mut self, mut number: u32) -> u32 {
        loop {
            let parent = self.parents[number as usize];
            if parent == number {
                return number;
            }
            let above = self.parents[parent as usize];
            self.parents[number as usize] = above;
            number = above;
        }
    }

    /// Makes one set of two; false if they are one.
    #[inline]
    pub(super) fn unite(&mut self, one: u32, other: u32) -> bool {
        let (one, other) = (self.find(one), self.find(other));
        self.parents[one.max(other) as usize] = one.min(other);
        one != other
    }
}

/// The components of one slab, numbered from 0 on.
#[derive(Debug, Default)]
pub(super) struct SlabComponents {
    pub(super) count: u32,
    /// Of each triangle of the front the slab begins with, its component.
    pub(super) front_before: Vec<u32>,
    /// Of each triangle of the front it leaves, which is the one that the next slab begins with.
    pub(super) front_after: Vec<u32>,
}

/// The components of all slabs so far.
#[derive(Default)]
pub(super) struct Components {
    /// There are so many, counting those that may still turn out to be one.
    pub(super) count: u64,
    /// Of each triangle of the front, its component: numbers below `labels`.
    front: Vec<u32>,
    labels: u32,
    sets: Sets,
}

impl Components {
    /// Adds the next slab: its components are those of the front where they share a triangle.
    pub(super) fn add(&mut self, slab: &SlabComponents) {
        assert_eq!(self.front.len(), slab.front_before.len(), "a front is passed on as it is");
        let labels = self.labels;
        self.count += u64::from(slab.count);
        self.sets.reset(labels + slab.count);
        for (before, now) in self.front.iter().zip(&slab.front_before) {
            self.count -= u64::from(self.sets.unite(*before, labels + now));
        }
        let mut new_labels = vec![NONE; (labels + slab.count) as usize];
        self.labels = 0;
        self.front.clear();
        for component in &slab.front_after {
            let label = &mut new_labels[self.sets.find(labels + component) as usize];
            if *label == NONE {
                *label = self.labels;
                self.labels += 1;
            }
            self.front.push(*label);
        }
    }
}

/// Stands for no label.
const NONE: u32 = u32::MAX;

#[cfg(test)]
mod tests {
    use super::*;

    fn slab(count: u32, before: &[u32], after: &[u32]) -> SlabComponents {
        SlabComponents { count, front_before: before.to_vec(), front_after: after.to_vec() }
    }

    #[test]
    fn a_horseshoe_is_one_once_its_arms_have_met() {
        // Two arms and a dot, then the arms alone, then both in one and another dot.
        let mut components = Components::default();
        components.add(&slab(3, &[], &[0, 0, 2]));
        assert_eq!(components.count, 3);
        components.add(&slab(2, &[1, 1, 0], &[0, 1, 1]));
        assert_eq!(components.count, 3);
        components.add(&slab(2, &[1, 1, 1], &[1]));
        assert_eq!(components.count, 3);
        components.add(&slab(1, &[0], &[]));
        assert_eq!(components.count, 3);
    }

    #[test]
    fn a_component_that_ends_is_counted_once() {
        let mut components = Components::default();
        components.add(&slab(1, &[], &[]));
        components.add(&slab(2, &[], &[1]));
        components.add(&slab(1, &[0], &[0]));
        components.add(&slab(5, &[4], &[]));
        assert_eq!(components.count, 1 + 2 + 4);
    }
}
