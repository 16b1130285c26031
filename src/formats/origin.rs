//! Coordinates far from the origin: an `f64` origin, and `f32` positions relative to it.
//!
//! Single precision at 500,000 m (UTM) resolves 3 cm. Sources with more precision than `f32`
//! (text, `double`, wide integers) are therefore stored relative to an origin near the mesh.

/// The origin all positions of a mesh are relative to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Origin {
    /// In model units; `None` until the first vertex is seen.
    chosen: Option<[f64; 3]>,
}

/// The origin is a multiple of this, so that taking it away from an `f64` is exact, and inputs
/// within it are left as they are. Chosen by hand: at 1024 units an `f32` still resolves 6e-5.
const STEP: f64 = 1024.0;

impl Origin {
    /// Positions are absolute.
    pub const ZERO: Self = Self { chosen: Some([0.0; 3]) };

    /// An origin to be chosen by the first vertex.
    #[must_use]
    pub const fn undecided() -> Self {
        Self { chosen: None }
    }

    /// An origin known beforehand.
    #[must_use]
    pub const fn at(origin: [f64; 3]) -> Self {
        Self { chosen: Some(origin) }
    }

    /// The origin; zero as long as no vertex was seen.
    #[must_use]
    pub fn get(&self) -> [f64; 3] {
        self.chosen.unwrap_or_default()
    }

    /// Whether a vertex or the caller has decided the origin.
    #[must_use]
    pub fn is_decided(&self) -> bool {
        self.chosen.is_some()
    }

    /// Stores `position` relative to the origin; the first finite position chooses it.
    /// A coordinate that single precision cannot hold becomes infinite.
    #[must_use]
    pub fn place(&mut self, position: [f64; 3]) -> [f32; 3] {
        let origin = match self.chosen {
            Some(origin) => origin,
            None if position.iter().all(|c| c.is_finite()) => {
                *self.chosen.insert(position.map(nearest_step))
            }
            None => return position.map(|c| c as f32),
        };
        std::array::from_fn(|axis| (position[axis] - origin[axis]) as f32)
    }
}

/// The multiple of [`STEP`] nearest to `coordinate`, towards zero. Beyond 2^52 steps every `f64`
/// is already as coarse as its neighbours, and stays absolute.
fn nearest_step(coordinate: f64) -> f64 {
    let steps = (coordinate / STEP).trunc();
    // Adding zero makes −0 a plain zero: the origin is written to files.
    if steps.abs() < 4e15 { steps * STEP + 0.0 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mesh_near_zero_keeps_its_coordinates() {
        let mut origin = Origin::undecided();
        assert_eq!(origin.place([1.5, -700.25, 0.0]), [1.5, -700.25, 0.0]);
        assert_eq!(origin.get().map(f64::to_bits), [0; 3]);
    }

    #[test]
    fn a_far_mesh_keeps_its_millimetres() {
        let mut origin = Origin::undecided();
        let first = [500_000.001, 5_400_000.002, 100.003];
        let second = [500_001.004, 5_400_002.005, 101.006];
        for position in [first, second] {
            let placed = origin.place(position);
            for axis in 0..3 {
                let back = f64::from(placed[axis]) + origin.get()[axis];
                assert!((back - position[axis]).abs() < 1e-4, "{back} {}", position[axis]);
            }
        }
    }
}
