//! What each element of a header means to us: which numbers of a record are carried, which are
//! skipped, and how long a record is.

use super::{
    super::{cursor::shorten, fault::Result, findings::Findings},
    header::{Element, Encoding, Header, Property, Shape, expected},
    scalar::Scalar,
};
use crate::error::Position;

/// What the records of an element are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    Vertices,
    Faces,
    /// Triangle strips, as the scanning software of the nineties wrote them.
    Strips,
    /// Nothing we carry.
    Other,
}

/// What to do with the next number or list of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// A coordinate: x, y, z are 0, 1, 2.
    Axis(Scalar, usize),
    /// A colour: red, green, blue, alpha are 0, 1, 2, 3.
    Channel(Scalar, usize),
    /// The indices of a face or strip.
    Corners { count: Scalar, item: Scalar },
    /// Numbers in a row that are not carried.
    Skip { bytes: u64, words: u64 },
    /// A list that is not carried.
    SkipList { count: Scalar, item: Scalar },
}

/// An element and the recipe of its records.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    pub(super) role: Role,
    pub(super) count: u64,
    pub(super) steps: Vec<Step>,
    /// Place of the `element` line.
    pub(super) at: Position,
    /// The part of the input that truncation is reported in.
    pub(super) inside: &'static str,
}

/// Names of vertex properties, in the order of the axes and channels.
const AXES: [&str; 3] = ["x", "y", "z"];
const CHANNELS: [[&str; 4]; 2] = [
    ["red", "green", "blue", "alpha"],
    ["diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"],
];
const INDICES: [&str; 2] = ["vertex_indices", "vertex_index"];

/// The layouts of all elements in file order; what is not carried is named in `findings`.
pub(super) fn layouts(header: &Header, findings: &mut Findings) -> Result<Vec<Layout>> {
    for line in &header.unknown_lines {
        findings.drop_attribute(&format!("header line {line:?}"));
    }
    let mut seen = Vec::new();
    let layout_of = |element: &Element| {
        let role = match element.name.as_str() {
            "vertex" => Role::Vertices,
            "face" => Role::Faces,
            "tristrips" => Role::Strips,
            _ => Role::Other,
        };
        if role != Role::Other && seen.contains(&role) {
            let found = element.name.as_bytes();
            return Err(expected("one element of each name", found, element.at));
        }
        seen.push(role);
        layout(element, role, findings)
    };
    let layouts: Vec<_> = header.elements.iter().map(layout_of).collect::<Result<_>>()?;
    if layouts.iter().all(|layout| layout.role != Role::Vertices) {
        return Err(expected("a vertex element in the header", b"end_header", header.end));
    }
    Ok(layouts)
}

fn layout(element: &Element, role: Role, findings: &mut Findings) -> Result<Layout> {
    let channels = channels_of(element);
    let mut steps: Vec<Step> = Vec::with_capacity(element.properties.len());
    let mut taken = Vec::new();
    for property in &element.properties {
        let step = match role {
            Role::Vertices => vertex_step(property, channels),
            Role::Faces | Role::Strips => face_step(property),
            Role::Other => None,
        };
        let key = step.map(|step| match step {
            Step::Axis(_, axis) => axis,
            Step::Channel(_, channel) => 3 + channel,
            _ => 7,
        });
        // Of two properties with one name the first is meant.
        if let (Some(step), Some(key)) = (step, key.filter(|key| !taken.contains(key))) {
            taken.push(key);
            steps.push(step);
        } else {
            name_dropped(property, role, findings);
            push_skip(&mut steps, property.shape);
        }
    }
    let (needed, what, inside): (&[usize], _, _) = match role {
        Role::Vertices => (&[0, 1, 2], "properties x, y and z of the vertices", "the vertices"),
        Role::Faces => (&[7], "a list property vertex_indices", "the faces"),
        Role::Strips => (&[7], "a list property vertex_indices", "the triangle strips"),
        Role::Other => (&[], "", "an element that is not carried"),
    };
    if element.count > 0 && needed.iter().any(|key| !taken.contains(key)) {
        return Err(expected(what, element.name.as_bytes(), element.at));
    }
    if role == Role::Other && element.count > 0 {
        findings.drop_attribute(&format!("element {}", shorten(element.name.as_bytes())));
    }
    Ok(Layout { role, count: element.count, steps, at: element.at, inside })
}

/// The naming scheme of which all three colours are there.
fn channels_of(element: &Element) -> Option<[&'static str; 4]> {
    let has = |name: &str| {
        let is_it =
            |property: &Property| property.name == name && matches!(property.shape, Shape::One(_));
        element.properties.iter().any(is_it)
    };
    CHANNELS.into_iter().find(|names| names[..3].iter().all(|name| has(name)))
}

fn vertex_step(property: &Property, channels: Option<[&str; 4]>) -> Option<Step> {
    let Shape::One(scalar) = property.shape else { return None };
    let name = property.name.as_str();
    if let Some(axis) = AXES.iter().position(|axis| *axis == name) {
        return Some(Step::Axis(scalar, axis));
    }
    let channel = channels?.iter().position(|channel| *channel == name)?;
    Some(Step::Channel(scalar, channel))
}

fn face_step(property: &Property) -> Option<Step> {
    match property.shape {
        Shape::List { count, item } if INDICES.contains(&property.name.as_str()) => {
            item.is_integer().then_some(Step::Corners { count, item })
        }
        _ => None,
    }
}

fn push_skip(steps: &mut Vec<Step>, shape: Shape) {
    match (steps.last_mut(), shape) {
        (Some(Step::Skip { bytes, words }), Shape::One(scalar)) => {
            *bytes += scalar.size_bytes() as u64;
            *words += 1;
        }
        (_, Shape::One(scalar)) => {
            steps.push(Step::Skip { bytes: scalar.size_bytes() as u64, words: 1 });
        }
        (_, Shape::List { count, item }) => steps.push(Step::SkipList { count, item }),
    }
}

fn name_dropped(property: &Property, role: Role, findings: &mut Findings) {
    let owner = match role {
        Role::Vertices => "vertex",
        Role::Faces => "face",
        Role::Strips => "strip",
        Role::Other => return,
    };
    match property.name.as_str() {
        "nx" | "ny" | "nz" => findings.drop_attribute("normals"),
        "s" | "t" | "u" | "v" | "texture_u" | "texture_v" | "texcoord" | "texnumber" => {
            findings.drop_attribute("texture coordinates");
        }
        "red" | "green" | "blue" | "alpha" if role != Role::Vertices => {
            findings.drop_attribute(&format!("{owner} colours"));
        }
        name => findings.drop_attribute(&format!("{owner} {}", shorten(name.as_bytes()))),
    }
}

impl Layout {
    /// Bytes a record takes at least in `encoding`: lists empty, numbers of one digit.
    pub(super) fn record_bytes_min(&self, encoding: Encoding) -> u64 {
        let bytes_and_words = self.steps.iter().map(|step| match *step {
            Step::Skip { bytes, words } => (bytes, words),
            Step::Axis(scalar, _) | Step::Channel(scalar, _) => (scalar.size_bytes() as u64, 1),
            Step::Corners { count, .. } | Step::SkipList { count, .. } => {
                (count.size_bytes() as u64, 1)
            }
        });
        match encoding {
            Encoding::Binary(_) => bytes_and_words.map(|(bytes, _)| bytes).sum(),
            Encoding::Ascii => bytes_and_words.map(|(_, words)| 2 * words).sum(),
        }
    }

    /// Whether every record has the same length in a binary body.
    pub(super) fn is_fixed(&self) -> bool {
        !self.steps.iter().any(|s| matches!(s, Step::Corners { .. } | Step::SkipList { .. }))
    }

    /// Whether a coordinate has more than single precision.
    pub(super) fn is_wider_than_single(&self) -> bool {
        self.steps
            .iter()
            .any(|s| matches!(s, Step::Axis(scalar, _) if scalar.is_wider_than_single()))
    }

    /// Whether records have a colour.
    pub(super) fn has_colors(&self) -> bool {
        self.steps.iter().any(|step| matches!(step, Step::Channel(..)))
    }
}
