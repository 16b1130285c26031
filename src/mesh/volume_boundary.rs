//! Collapses along a boundary by volume and area `[LT98]`: few, and so done one by one, in double
//! precision.

use glam::{DMat3, DVec3};

use super::{
    ByVolume, Mesh, State,
    classify::is_end,
    metric::Candidate,
    ring::Wing,
    surface::NONE,
    volume::{MIDDLE_WEIGHT, REACH_SQ},
};

/// Weight of squared areas swept over by the boundary, relative to the squared length of the edge:
/// `[LT98]` weighs (volume)² and length²·(area)² alike, and costs here are (6 volume)², while areas
/// come doubled.
const AREA_WEIGHT: f64 = 9.0;

/// Weight of the sum of those areas, which should vanish, relative to themselves. Chosen by hand:
/// the boundary keeps its area as far as its shape allows.
const AREA_KEPT_WEIGHT: f64 = 100.0;

/// E(x) = xᵀHx − 2·c·x + k.
struct Form {
    h: DMat3,
    c: DVec3,
    k: f64,
}

impl Form {
    const ZERO: Self = Self { h: DMat3::ZERO, c: DVec3::ZERO, k: 0.0 };

    /// Adds (n·x − d)².
    fn add_plane(&mut self, n: DVec3, d: f64) {
        self.h += outer(n);
        self.c += n * d;
        self.k += d * d;
    }

    /// Adds `weight`·|e × x + m|²: with m = Σ s × t over edges from s to t with the sum e, this is
    /// the squared double area that they sweep over on their way to x.
    fn add_areas(&mut self, e: DVec3, m: DVec3, weight: f64) {
        self.h += (DMat3::IDENTITY * e.length_squared() - outer(e)) * weight;
        self.c -= m.cross(e) * weight;
        self.k += m.length_squared() * weight;
    }

    fn at(&self, x: DVec3) -> f64 {
        x.dot(self.h * x - 2.0 * self.c) + self.k
    }
}

fn outer(n: DVec3) -> DMat3 {
    DMat3::from_cols(n * n.x, n * n.y, n * n.z)
}

/// The cheapest collapse that removes a vertex on a boundary: along the boundary only.
pub(super) fn cheapest(
    mesh: &Mesh<ByVolume>,
    vertex: u32,
    ring: &[Wing],
    except: &[u32],
) -> Option<Candidate> {
    let mut best = Candidate { kept: NONE, cost: f32::INFINITY, to: mesh.position(vertex) };
    let ends = ring.iter().flat_map(|wing| [wing.next, wing.prev]);
    for other in ends.filter(|other| is_end(ring, *other) && !except.contains(other)) {
        if let Some(candidate) = collapse(mesh, vertex, ring, other)
            && candidate.cost < best.cost
        {
            best = candidate;
        }
    }
    (best.kept != NONE).then_some(best)
}

/// The collapse of the boundary edge from `removed` to `kept`.
fn collapse(mesh: &Mesh<ByVolume>, removed: u32, ring: &[Wing], kept: u32) -> Option<Candidate> {
    let unit = f64::from(mesh.unit);
    let from = mesh.position(removed).as_dvec3();
    let at = |vertex: u32| (mesh.position(vertex).as_dvec3() - from) * unit;
    let (mut form, mut volume, mut g) = (Form::ZERO, 0.0, DVec3::ZERO);
    let mut edges = Vec::with_capacity(3);
    for (end, other, ring) in [(removed, kept, ring), (kept, removed, mesh.rings.of(kept))] {
        let p = at(end);
        for wing in ring {
            for (vertex, s, t) in [(wing.next, p, at(wing.next)), (wing.prev, at(wing.prev), p)] {
                // The edge between the two is met from both sides.
                if is_end(ring, vertex) && (vertex != other || end == removed) {
                    edges.push((s, t));
                }
            }
            if end == removed || !wing.has(other) {
                let n = (at(wing.next) - p).cross(at(wing.prev) - p);
                let d = n.dot(p);
                form.add_plane(n, d);
                g += n;
                volume += d;
            }
        }
    }
    let e = at(kept);
    let weight = AREA_WEIGHT * e.length_squared();
    let mut all = (DVec3::ZERO, DVec3::ZERO);
    for (s, t) in edges {
        form.add_areas(t - s, s.cross(t), weight);
        all = (all.0 + (t - s), all.1 + s.cross(t));
    }
    if mesh.states[kept as usize] != State::BOUNDARY {
        let cost = form.at(e).max(0.0) as f32;
        return Some(Candidate { kept, cost, to: mesh.position(kept) });
    }
    let x = place(&form, all, weight, (g, volume), e)?;
    let to = (from + x / unit).as_vec3();
    Some(Candidate { kept, cost: form.at(x).max(0.0) as f32, to })
}

/// Where the new vertex lies: the volume is kept, and the area of the boundary about.
fn place(
    form: &Form,
    (edge, areas): (DVec3, DVec3),
    weight: f64,
    (g, volume): (DVec3, f64),
    e: DVec3,
) -> Option<DVec3> {
    let mut kept = Form { h: form.h, c: form.c, k: 0.0 };
    kept.add_areas(edge, areas, weight * AREA_KEPT_WEIGHT);
    let trace = form.h.x_axis.x + form.h.y_axis.y + form.h.z_axis.z;
    let stay = trace * f64::from(MIDDLE_WEIGHT);
    let inverse = (kept.h + DMat3::from_diagonal(DVec3::splat(stay))).inverse();
    let free = inverse * (kept.c + e * (0.5 * stay));
    let along = inverse * g;
    let slope = g.dot(along);
    let step = if slope > 0.0 { (volume - g.dot(free)) / slope } else { 0.0 };
    let x = free + along * step;
    let is_near = (x - e * 0.5).length_squared() <= f64::from(REACH_SQ) * e.length_squared();
    (x.is_finite() && is_near).then_some(x)
}
