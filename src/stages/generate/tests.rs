//! What every surface must be: closed, oriented, counted, bounded, and the same every time.

use std::collections::HashMap;

use super::*;
use crate::{
    formats::Content,
    progress::{Cancel, Event, StageId},
};

fn config(kind: Kind, triangles: u64, layout: Layout) -> Config {
    Config { kind, triangles, noise: NOISE_DEFAULT, seed: 1, layout }
}

/// Everything delivered, and the sizes of the batches it came in.
#[derive(Default, PartialEq, Debug)]
struct Made {
    positions: Vec<[f32; 3]>,
    corners: Vec<u64>,
    batches: Vec<(Content, usize)>,
}

fn make(config: &Config) -> (Made, Outcome) {
    let mut made = Made::default();
    let outcome = generate(config, &Monitor::silent(), &mut |batch| {
        assert!(batch.count() > 0);
        made.positions.extend_from_slice(&batch.positions);
        made.corners.extend_from_slice(&batch.faces.corners);
        made.batches.push((batch.content, batch.count()));
        Ok(())
    });
    (made, outcome.unwrap())
}

/// Edges by how they are used: (boundary, shared by more than two or in the same direction).
fn odd_edges(corners: &[u64]) -> (usize, usize) {
    let mut uses: HashMap<(u64, u64), (u32, u32)> = HashMap::new();
    for triangle in corners.chunks(3) {
        for side in 0..3 {
            let (a, b) = (triangle[side], triangle[(side + 1) % 3]);
            let both = uses.entry((a.min(b), a.max(b))).or_default();
            if a < b { both.0 += 1 } else { both.1 += 1 }
        }
    }
    let boundary = uses.values().filter(|both| both.0 + both.1 == 1).count();
    let wrong = uses.values().filter(|both| both.0 > 1 || both.1 > 1).count();
    (boundary, wrong)
}

/// Whether the triangles around each vertex are one fan.
fn every_vertex_is_one_fan(vertices: usize, corners: &[u64]) -> bool {
    let mut after: HashMap<(u64, u64), u64> = HashMap::new();
    let mut around = vec![0; vertices];
    for triangle in corners.chunks(3) {
        for corner in 0..3 {
            let [v, a, b] = [0, 1, 2].map(|step| triangle[(corner + step) % 3]);
            after.insert((v, a), b);
            around[v as usize] += 1;
        }
    }
    let starts: HashMap<u64, u64> = after.keys().copied().collect();
    (0..vertices as u64).all(|v| {
        let (start, mut at, mut steps) = (starts[&v], starts[&v], 0);
        loop {
            at = after[&(v, at)];
            steps += 1;
            if at == start {
                return steps == around[v as usize];
            }
        }
    })
}

fn cross(positions: &[[f32; 3]]) -> glam::DVec3 {
    let [a, b, c] =
        [0, 1, 2].map(|corner| glam::DVec3::from_array(positions[corner].map(f64::from)));
    (b - a).cross(c - a)
}

fn volume(soup: &[[f32; 3]]) -> f64 {
    let of = |t: &[[f32; 3]]| glam::DVec3::from_array(t[0].map(f64::from)).dot(cross(t)) / 6.0;
    soup.chunks(3).map(of).sum()
}

fn dereference(made: &Made) -> Vec<[f32; 3]> {
    made.corners.iter().map(|&corner| made.positions[corner as usize]).collect()
}

fn euler(made: &Made) -> i64 {
    made.positions.len() as i64 - made.corners.len() as i64 / 6
}

#[test]
fn closed_kinds_are_closed_oriented_two_manifolds() {
    for kind in [Kind::Gyroid, Kind::Sphere] {
        for triangles in [12, 500, 30_000] {
            let (made, _) = make(&config(kind, triangles, Layout::Indexed));
            assert_eq!(odd_edges(&made.corners), (0, 0), "{kind:?} {triangles}");
            assert!(every_vertex_is_one_fan(made.positions.len(), &made.corners));
            assert_eq!(euler(&made) % 2, 0);
            assert!(volume(&dereference(&made)) > 0.0);
        }
    }
}

#[test]
fn a_sphere_is_one_in_topology_and_in_volume() {
    for triangles in [12, 3000, 200_000] {
        let (made, _) = make(&config(Kind::Sphere, triangles, Layout::Indexed));
        assert_eq!(euler(&made), 2, "{triangles}");
    }
    let smooth = Config { noise: 0.0, ..config(Kind::Sphere, 100_000, Layout::Soup) };
    let ball = std::f64::consts::PI * 4.0 / 3.0;
    assert!((volume(&make(&smooth).0.positions) / ball - 1.0).abs() < 1e-3);
}

#[test]
fn a_gyroid_has_many_handles() {
    let (made, _) = make(&config(Kind::Gyroid, 100_000, Layout::Indexed));
    assert!(euler(&made) < -100, "{}", euler(&made));
}

#[test]
fn a_height_field_has_its_rim_as_only_boundary() {
    // 50 × 50 cells: 200 edges around them.
    let (made, outcome) = make(&config(Kind::HeightField, 5000, Layout::Indexed));
    assert_eq!(outcome.counts, Counts { vertices: 51 * 51, triangles: 5000 });
    assert_eq!(odd_edges(&made.corners), (200, 0));
    assert_eq!(euler(&made) - 100, 1, "a disc: 200 boundary edges weigh half each");
    let up = dereference(&made).chunks(3).all(|triangle| cross(triangle).z > 0.0);
    assert!(up, "counter-clockwise from above");
}

#[test]
fn a_soup_is_the_indexed_mesh_dereferenced_bit_for_bit() {
    for kind in [Kind::Gyroid, Kind::Sphere, Kind::HeightField] {
        let (indexed, with) = make(&config(kind, 70_000, Layout::Indexed));
        let (soup, without) = make(&config(kind, 70_000, Layout::Soup));
        assert_eq!(dereference(&indexed), soup.positions, "{kind:?}");
        assert_eq!(with.bounds, without.bounds);
        assert_eq!(with.counts.triangles, without.counts.triangles);
        assert_eq!(without.counts.vertices, 0);
    }
}

#[test]
fn what_is_counted_is_what_is_delivered() {
    for kind in [Kind::Gyroid, Kind::Sphere, Kind::HeightField] {
        for layout in [Layout::Soup, Layout::Indexed] {
            for triangles in [1, 777, 100_000] {
                let config = config(kind, triangles, layout);
                let (made, outcome) = make(&config);
                let (vertices, corners) = match layout {
                    Layout::Soup => (0, made.positions.len()),
                    Layout::Indexed => (made.positions.len(), made.corners.len()),
                };
                let delivered = Counts { vertices: vertices as u64, triangles: corners as u64 / 3 };
                assert_eq!(outcome.counts, delivered);
                assert_eq!(count(&config, &Monitor::silent()).unwrap(), delivered);
            }
        }
    }
}

#[test]
fn the_wanted_size_is_met() {
    let sizes = [(1000, 0.15), (2500, 0.15), (10_000, 0.03), (123_456, 0.03), (1_000_000, 0.03)];
    for kind in [Kind::Gyroid, Kind::Sphere] {
        for (wanted, tolerance) in sizes {
            let counts = count(&config(kind, wanted, Layout::Soup), &Monitor::silent()).unwrap();
            let ratio = counts.triangles as f64 / wanted as f64;
            assert!((ratio - 1.0).abs() < tolerance, "{kind:?} {wanted}: {}", counts.triangles);
        }
        let least = count(&config(kind, 12, Layout::Indexed), &Monitor::silent()).unwrap();
        assert_eq!(least, Counts { vertices: 14, triangles: 24 });
    }
    for wanted in [1u64, 2, 3, 12, 13, 4999, 5001, 1_000_003] {
        let config = config(Kind::HeightField, wanted, Layout::Soup);
        let triangles = count(&config, &Monitor::silent()).unwrap().triangles;
        let row = 2.0 * (wanted as f64 / 2.0).sqrt().round().max(1.0);
        assert!((triangles as f64 - wanted as f64).abs() <= row / 2.0, "{wanted} {triangles}");
    }
}

#[test]
fn triangles_have_an_area_and_lie_in_the_bounds() {
    for kind in [Kind::Gyroid, Kind::Sphere, Kind::HeightField] {
        for noise in [0.0, NOISE_DEFAULT, NOISE_MAX] {
            let config = Config { noise, ..config(kind, 60_000, Layout::Soup) };
            let (made, outcome) = make(&config);
            let mut bounds = Bounds::default();
            for triangle in made.positions.chunks(3) {
                assert!(triangle.iter().flatten().all(|coordinate| coordinate.is_finite()));
                assert!(cross(triangle).length() > 0.0, "{kind:?} {triangle:?}");
                for position in triangle {
                    bounds.add(*position);
                }
            }
            assert_eq!(outcome.bounds, bounds);
            assert!(bounds.diagonal() > 2.0 && bounds.diagonal() < 6.0);
        }
    }
}

#[test]
fn the_bytes_do_not_depend_on_the_threads_but_on_the_seed() {
    for kind in [Kind::Gyroid, Kind::Sphere, Kind::HeightField] {
        for layout in [Layout::Soup, Layout::Indexed] {
            let config = config(kind, 100_000, layout);
            let on = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| make(&config))
            };
            let one = on(1);
            assert_eq!(one, on(2));
            assert_eq!(one, make(&config));
            assert_ne!(one.0.positions, make(&Config { seed: 2, ..config }).0.positions);
        }
    }
}

#[test]
fn triangles_come_in_sweep_order() {
    let (made, _) = make(&config(Kind::Gyroid, 100_000, Layout::Soup));
    let lowest = made.positions.chunks(3).map(|t| t[0][2].min(t[1][2]).min(t[2][2]));
    let mut front = f32::NEG_INFINITY;
    for z in lowest {
        // A cell is 0.052 wide at this size.
        assert!(z > front - 0.06, "one layer back at most");
        front = front.max(z);
    }
}

#[test]
fn batches_are_full_but_for_the_last_of_each_kind() {
    let (made, _) = make(&config(Kind::Sphere, 200_000, Layout::Indexed));
    let faces = made.batches.iter().position(|batch| batch.0 == Content::Faces).unwrap();
    for batches in [&made.batches[..faces], &made.batches[faces..]] {
        assert!(batches.iter().all(|batch| batch.0 == batches[0].0));
        let full = &batches[..batches.len() - 1];
        assert!(full.iter().all(|batch| batch.1 == crate::formats::BATCH_RECORDS));
    }
}

#[test]
fn a_raised_flag_stops_the_sweep() {
    for kind in [Kind::Gyroid, Kind::HeightField] {
        let cancel = Cancel::default();
        let monitor = Monitor { observer: &(), cancel: cancel.clone() };
        let config = config(kind, 300_000, Layout::Soup);
        let stopped = generate(&config, &monitor, &mut |_| {
            cancel.raise();
            Ok(())
        });
        assert!(matches!(stopped, Err(Error::Cancelled(at)) if at.0 == StageId::Generate));
    }
}

#[test]
fn a_sink_that_fails_ends_the_sweep() {
    let mut calls = 0;
    let failed =
        generate(&config(Kind::Sphere, 300_000, Layout::Soup), &Monitor::silent(), &mut |_| {
            calls += 1;
            Err(Error::Request("full".to_owned()))
        });
    assert!(matches!(failed, Err(Error::Request(_))));
    assert_eq!(calls, 1);
}

#[test]
fn every_pass_visits_what_it_announced() {
    let open = std::sync::Mutex::new(Vec::new());
    let observer = |event: &Event| {
        let mut open = open.lock().unwrap();
        match *event {
            Event::Started { stage: StageId::Generate, total, .. } => open.push(total.unwrap()),
            Event::Finished { stage: StageId::Generate, done } => {
                assert_eq!(open.pop(), Some(done));
            }
            _ => {}
        }
    };
    let monitor = Monitor { observer: &observer, cancel: Cancel::default() };
    for kind in [Kind::Gyroid, Kind::HeightField] {
        generate(&config(kind, 20_000, Layout::Indexed), &monitor, &mut |_| Ok(())).unwrap();
    }
    assert!(open.lock().unwrap().is_empty());
}

#[test]
fn what_cannot_be_made_is_refused() {
    let sound = config(Kind::Sphere, 100, Layout::Soup);
    for wrong in [
        Config { triangles: 0, ..sound },
        Config { triangles: TRIANGLES_MAX + 1, ..sound },
        Config { noise: -0.1, ..sound },
        Config { noise: f64::NAN, ..sound },
        Config { noise: NOISE_MAX + 0.01, ..sound },
    ] {
        assert!(matches!(count(&wrong, &Monitor::silent()), Err(Error::Request(_))));
        let made = generate(&wrong, &Monitor::silent(), &mut |_| Ok(()));
        assert!(matches!(made, Err(Error::Request(_))));
    }
}
