//! What `simplify` keeps to under an error bound: the flags, and what they mean.

use clap::{Args, ValueEnum};
use meshmill::pipeline::{self, MaxError};

use super::values;

/// What --method bounded keeps to, beside the error bound.
#[derive(Debug, Args)]
#[command(next_help_heading = "Under an error bound (--max-error)")]
pub(super) struct Keep {
    /// Which of the allowed collapses comes first; see each below
    #[arg(long, value_enum, default_value_t = Fairing::Error)]
    pub(super) fairing: Fairing,

    /// --fairing shape: longest edge over inner radius a collapse may give a triangle, 3.46 at best
    #[arg(long, value_name = "R", value_parser = values::roundness, default_value = "20")]
    pub(super) max_roundness: f32,

    /// --fairing smooth: dihedral angle a collapse may make, in degrees
    #[arg(long, value_name = "DEG", value_parser = values::angle, default_value = "90")]
    pub(super) max_dihedral: f32,

    /// --fairing smooth: what is ranked anew around a collapse; see each below
    #[arg(long, value_enum, default_value_t = Update::Best)]
    pub(super) fairing_update: Update,

    /// Vertex colours, too: how far the colour of a vertex of the input may be from the one the result
    /// has at the nearest point of the triangle that stands for it. ΔE of 1976, the distance in
    /// CIELAB, in which colours are interpolated: 2.3 can just be seen, 100 is from black to white
    #[arg(long, value_name = "DE", value_parser = values::color_error)]
    pub(super) max_color_error: Option<f32>,

    /// Normals, too: how far the normal of a vertex of the input may be from the normal of the triangle
    /// that stands for it, in degrees
    #[arg(long, value_name = "DEG", value_parser = values::angle)]
    pub(super) max_normal_deviation: Option<f32>,

    /// Which way distances are looked at; see each below
    #[arg(long, value_enum, default_value_t = Sides::One)]
    pub(super) error_side: Sides,
}

impl Keep {
    /// What it means, with the error bound itself.
    pub(super) fn meaning(&self, max_error: Option<MaxError>) -> pipeline::Keep {
        pipeline::Keep {
            max_error,
            limits: pipeline::Limits {
                color: self.max_color_error,
                normal: self.max_normal_deviation.map(f32::to_radians),
            },
            fairing: match self.fairing {
                Fairing::Error => pipeline::Fairing::Error,
                Fairing::Shape => {
                    pipeline::Fairing::Shape(pipeline::Shape { roundness_max: self.max_roundness })
                }
                Fairing::Smooth => pipeline::Fairing::Smooth(pipeline::Smooth {
                    angle_max: self.max_dihedral.to_radians(),
                }),
            },
            sides: match self.error_side {
                Sides::One => pipeline::Sides::One,
                Sides::Both => pipeline::Sides::Both,
            },
            update: match self.fairing_update {
                Update::Best => pipeline::Update::Best,
                Update::All => pipeline::Update::All,
            },
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Fairing {
    /// Those that change the surface least: the fewest triangles
    Error,
    /// Those that leave round triangles: for simulation and other further processing
    Shape,
    /// Those that leave small angles between triangles: to look at
    Smooth,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Update {
    /// The collapse of each neighbour that was the best: faster
    Best,
    /// All collapses of all neighbours
    All,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Sides {
    /// From every vertex of the input to the result
    One,
    /// At each collapse from the new triangles to the old ones, too: does not span hollows
    Both,
}
