//! What is drawn, sample by sample and as a whole.

use std::f32::consts::{PI, TAU};

use glam::{DMat3, DVec3};
use rand_xoshiro::{
    Xoshiro256PlusPlus,
    rand_core::{RngCore as _, SeedableRng as _},
};

use super::{
    camera::Extent,
    frame::{Frame, Seen},
    raster::{self, Style},
    *,
};
use crate::{
    Error, Result,
    progress::{Cancel, Event, Monitor, StageId},
    soup::{ColoredPoint, Point, Source, Triangle, Vertex},
    storage::{RecordWriter, Workspace},
};

const PLAIN: Style = Style { edge: None };

/// Looks along z at a square from (0, 0, 0) on, in which a sample is one unit wide; y points down.
fn projection(samples: usize) -> Projection {
    let side = DVec3::splat(samples as f64);
    let extent = Extent { min: DVec3::ZERO, max: side };
    let area = Area { left: 0, top: 0, width: samples, height: samples };
    Projection::new(DMat3::IDENTITY, &extent, area, 256.0)
}

fn drawn(triangles: &[[[f32; 3]; 3]], samples: usize) -> Frame {
    let triangles: Vec<_> = triangles.iter().map(|t| Triangle(t.map(Point))).collect();
    let frame = Frame::new(samples, samples);
    raster::draw(&triangles, &projection(samples), PLAIN, &frame);
    frame
}

fn covered(frame: &Frame) -> Vec<String> {
    let letter = |row, column| if frame.sample(row, column).is_some() { '#' } else { '.' };
    (0..frame.height).map(|row| (0..frame.width).map(|c| letter(row, c)).collect()).collect()
}

fn everything(frame: &Frame) -> Vec<Option<(f32, Seen)>> {
    (0..frame.height)
        .flat_map(|row| (0..frame.width).map(move |column| frame.sample(row, column)))
        .collect()
}

#[test]
fn a_triangle_covers_the_samples_whose_middle_is_in_it() {
    // Its left edge is on the middles of a column, its hypotenuse on those of a diagonal.
    let frame = drawn(&[[[1.5, 0.0, 1.0], [1.5, 4.0, 1.0], [5.5, 0.0, 1.0]]], 6);
    let other = drawn(&[[[1.5, 4.0, 1.0], [5.5, 4.0, 1.0], [5.5, 0.0, 1.0]]], 6);
    let (one, other) = (covered(&frame), covered(&other));
    let whole = ["......"; 6].map(str::to_owned);
    assert_ne!(one, whole);
    let mut both = Vec::new();
    for (one, other) in one.iter().zip(&other) {
        let pairs = one.chars().zip(other.chars());
        assert!(pairs.clone().all(|pair| pair != ('#', '#')), "covered twice");
        both.push(pairs.map(|p| if p == ('.', '.') { '.' } else { '#' }).collect::<String>());
    }
    // Of the two edges on middles of columns, one has them and the other has not.
    let square = if both[0].starts_with(".#") { ".####." } else { "..####" };
    assert_eq!(both, [[square; 4].as_slice(), &["......"; 2]].concat());
    assert_eq!(frame.sample(0, 2).map(|(depth, _)| depth), frame.sample(1, 3).map(|(d, _)| d));
}

#[test]
fn the_nearer_triangle_is_seen_and_depth_is_that_of_the_plane() {
    // Two crossing planes: one rises to the right, one to the left.
    let rising = [[-9.0, -9.0, 0.0], [-9.0, 30.0, 0.0], [30.0, -9.0, 8.0]];
    let falling = rising.map(|[x, y, z]: [f32; 3]| [x, y, 6.0 - z]);
    let (one, other) = (drawn(&[rising], 8), drawn(&[falling], 8));
    let both = drawn(&[rising, falling], 8);
    let turned = drawn(&[falling, rising], 8);
    assert_eq!(everything(&both), everything(&turned));
    for (index, seen) in everything(&both).into_iter().enumerate() {
        let (row, column) = (index / 8, index % 8);
        let [one, other] = [&one, &other].map(|frame| frame.sample(row, column).unwrap());
        let nearer = if one.0 < other.0 { one } else { other };
        assert_eq!(seen, Some(nearer));
        let at = projection(8).position([column, row], one.0);
        let expected = [column as f64 + 0.5, row as f64 + 0.5, (column as f64 + 9.5) * 8.0 / 39.0];
        assert!(at.iter().zip(expected).all(|(a, e)| (a - e).abs() < 0.02), "{at:?} {expected:?}");
    }
}

#[test]
fn large_triangles_and_slivers_cover_what_each_sample_says() {
    const SIDE: u8 = 70;
    let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
    let mut coordinate = || (random.next_u64() % 25_600) as f32 / 256.0 - 15.0;
    for _ in 0..200 {
        let corners: [[f32; 2]; 3] = [(); 3].map(|()| [coordinate(), coordinate()]);
        let frame = drawn(&[corners.map(|[x, y]| [x, y, 1.0])], SIDE.into());
        let side = |p: [f32; 2], q: [f32; 2], at: [f32; 2]| {
            // Exact: coordinates have 16 bits.
            let [p, q, at] = [p, q, at].map(|p| p.map(f64::from));
            (q[0] - p[0]) * (at[1] - p[1]) - (q[1] - p[1]) * (at[0] - p[0])
        };
        for (row, column) in (0..SIDE).flat_map(|row| (0..SIDE).map(move |column| (row, column))) {
            let at = [f32::from(column) + 0.5, f32::from(row) + 0.5];
            let sides = [0, 1, 2].map(|i| side(corners[i], corners[(i + 1) % 3], at));
            let is_in = sides.iter().all(|s| *s > 0.0) || sides.iter().all(|s| *s < 0.0);
            let is_out = sides.iter().any(|s| *s > 0.0) && sides.iter().any(|s| *s < 0.0);
            let is_drawn = frame.sample(row.into(), column.into()).is_some();
            assert!(is_drawn || !is_in, "{corners:?} misses {at:?}");
            assert!(!is_drawn || !is_out, "{corners:?} is drawn at {at:?}");
        }
    }
}

/// A closed sphere around (20, 20, 20).
fn sphere(radius: f32, rings: u16) -> Vec<[[f32; 3]; 3]> {
    let at = |ring: u16, step: u16| {
        let (up, around) = (f32::from(ring) / f32::from(rings), f32::from(step % rings));
        let (up, around) = (up * PI, around / f32::from(rings) * TAU);
        [up.sin() * around.cos(), up.sin() * around.sin(), up.cos()].map(|c| 20.0 + radius * c)
    };
    let square = |(ring, step)| {
        let [a, b, c, d] =
            [at(ring, step), at(ring + 1, step), at(ring + 1, step + 1), at(ring, step + 1)];
        [[a, b, c], [a, c, d]]
    };
    (0..rings).flat_map(|ring| (0..rings).map(move |step| (ring, step))).flat_map(square).collect()
}

#[test]
fn triangles_smaller_than_a_sample_leave_no_holes() {
    let sphere = sphere(18.0, 400);
    let frame = drawn(&sphere, 40);
    for (row, column) in (0..40_u16).flat_map(|row| (0..40_u16).map(move |column| (row, column))) {
        let distance = (f32::from(column) - 19.5).hypot(f32::from(row) - 19.5);
        let seen = frame.sample(row.into(), column.into());
        assert_eq!(seen.is_some(), distance < 18.0, "at {column} {row}");
        if let Some((_, seen)) = seen.filter(|_| distance < 17.5) {
            assert!(!seen.is_back());
            let expected = (f32::from(column) - 19.5) / 18.0;
            assert!((seen.normal().x - expected).abs() < 0.05);
        }
    }
}

#[test]
fn coordinates_that_are_no_numbers_or_far_away_are_drawn_somewhere_or_not_at_all() {
    for odd in [f32::NAN, f32::INFINITY, -1e30, f32::MAX] {
        for axis in 0..3 {
            let mut corners = [[1.0, 1.0, 1.0], [5.0, 1.0, 1.0], [1.0, 5.0, 1.0]];
            corners[1][axis] = odd;
            drop(drawn(&[corners], 8));
        }
    }
}

#[test]
fn points_that_are_seen_lie_on_the_surface_wherever_the_mesh_is() {
    let folder = tempfile::tempdir().unwrap();
    let workspace = Workspace::create(folder.path()).unwrap();
    let source = |triangles: &[[[f32; 3]; 3]]| {
        let mut writer = RecordWriter::create(&workspace, "soup", None).unwrap();
        writer.extend(&plain(triangles)).unwrap();
        Source::stored(writer.finish().unwrap())
    };
    let (monitor, budget) = (Monitor::silent(), workspace.budget());
    let config = config(&[View::Iso, View::Top]);
    // The same sphere twice, the second one around another origin.
    let shift = DVec3::new(64.0, -32.0, 8.0);
    let here = sphere(3.0, 100);
    let moved = |corner: [f32; 3]| DVec3::from(corner.map(f64::from)) - shift;
    let there: Vec<_> = here
        .iter()
        .map(|corners| corners.map(|corner| moved(corner).as_vec3().to_array()))
        .collect();
    let [here, there] = [source(&here), source(&there)];
    let [a, b] =
        [&here, &there].map(|s| Extents::measure(s, &config, budget, &monitor).unwrap().unwrap());
    let scene = Scene::new(&a.union(&b, shift), &config);
    let first = draw(&here, &scene, budget, &monitor).unwrap();
    let second = draw(&there, &scene.shifted(shift), budget, &monitor).unwrap();
    let (first, second) = (first.visible(), second.visible());
    assert!(first.len() > 1000 && first.len().abs_diff(second.len()) < 10);
    for (visible, shift) in [(&first, DVec3::ZERO), (&second, shift)] {
        for point in visible {
            let radius = (DVec3::from(point.position) + shift - 20.0).length();
            assert!((radius - 3.0).abs() < 0.02, "{point:?}");
        }
    }
}

#[test]
fn pixels_can_be_painted_and_stand_beside_each_other() {
    let triangles = plain(&sphere(3.0, 60));
    let folder = tempfile::tempdir().unwrap();
    let workspace = Workspace::create(folder.path()).unwrap();
    let mut writer = RecordWriter::create(&workspace, "soup", None).unwrap();
    writer.extend(&triangles).unwrap();
    let source = Source::stored(writer.finish().unwrap());
    let (monitor, budget, config) = (Monitor::silent(), workspace.budget(), config(&[View::Top]));
    let extents = Extents::measure(&source, &config, budget, &monitor).unwrap().unwrap();
    let drawing = draw(&source, &Scene::new(&extents, &config), budget, &monitor).unwrap();
    let painted = drawing.picture(&Paint::Pixels(&[[255, 0, 0]; 64 * 48]));
    let [red, green, blue] = painted.pixel(32, 24);
    assert!(red > 100 && green == 0 && blue == 0);
    let plain = drawing.picture(&Paint::Plaster);
    let heat = HeatMap::new(&[1.0]);
    let caption = ["one".to_owned()];
    let panels = [&plain, &painted].map(|picture| Panel { picture, caption: &caption });
    let sheet = side_by_side(&panels, heat);
    assert_eq!(sheet.width(), 128);
    let above = (0..sheet.height()).find(|row| sheet.pixel(64 + 32, *row + 24) == [red, 0, 0]);
    let above = above.unwrap();
    assert_eq!(sheet.pixel(32, above + 24), plain.pixel(32, 24));
    let rows = above + 48..sheet.height();
    let mut below = rows.flat_map(|row| (64..128).map(move |column| (column, row)));
    let bottom = below.any(|(column, row)| sheet.pixel(column, row) == heat.color(1.0));
    assert!(bottom, "the scale is below the last panel");
}

fn config(views: &[View]) -> Config {
    let size = Size { width: 64, height: 48 };
    Config { views: views.to_vec(), up: Up::Z, size, samples: 2, edges: Edges::Hidden }
}

fn rendered<V: Vertex>(
    triangles: &[Triangle<V>],
    config: &Config,
    monitor: &Monitor,
) -> Result<Outcome> {
    let folder = tempfile::tempdir().unwrap();
    let workspace = Workspace::create(folder.path()).unwrap();
    let mut writer = RecordWriter::create(&workspace, "soup", None).unwrap();
    writer.extend(triangles).unwrap();
    let source = Source::stored(writer.finish().unwrap());
    render(&source, config, workspace.budget(), monitor)
}

fn plain(triangles: &[[[f32; 3]; 3]]) -> Vec<Triangle<Point>> {
    triangles.iter().map(|triangle| Triangle(triangle.map(Point))).collect()
}

fn picture(triangles: &[[[f32; 3]; 3]], config: &Config) -> Picture {
    rendered(&plain(triangles), config, &Monitor::silent()).unwrap().picture
}

/// Share of pixels on which something is seen.
fn share(picture: &Picture) -> f64 {
    let background = Picture::new(1, 1, BACKGROUND).pixel(0, 0);
    let all = (0..picture.height()).flat_map(|row| (0..picture.width()).map(move |c| (c, row)));
    let seen = all.filter(|(column, row)| picture.pixel(*column, *row) != background).count();
    seen as f64 / (picture.width() * picture.height()) as f64
}

#[test]
fn a_sphere_fills_its_panel_from_everywhere() {
    for up in [Up::X, Up::Y, Up::Z] {
        for view in View::ALL {
            let picture = picture(&sphere(3.0, 60), &Config { up, ..config(&[view]) });
            // A circle as high as the picture without its margins.
            let expected = PI / 4.0 * (48.0_f32 * 0.92).powi(2) / (64.0 * 48.0);
            let share = share(&picture);
            assert!((share - f64::from(expected)).abs() < 0.06, "{view:?} {up:?}: {share}");
        }
    }
}

#[test]
fn the_same_triangles_make_the_same_picture_in_any_order_and_on_any_threads() {
    let mut triangles = sphere(3.0, 200);
    let config = config(&View::ALL);
    let expected = picture(&triangles, &config);
    triangles.reverse();
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert_eq!(pool.install(|| picture(&triangles, &config)), expected);
    }
}

#[test]
fn meshes_far_from_zero_flat_ones_and_single_points_have_a_picture() {
    let flat = |x: f32, scale: f32| {
        let corner = |a: f32, b: f32| [x + a * scale, x + b * scale, x];
        [[corner(0.0, 0.0), corner(1.0, 0.0), corner(0.0, 1.0)]]
    };
    let near = picture(&flat(0.0, 64.0), &config(&[View::Top]));
    assert!((share(&near) - 0.35).abs() < 0.05, "{}", share(&near));
    // Single precision has sixteenths there.
    assert_eq!(picture(&flat(1_000_000.0, 64.0), &config(&[View::Top])), near);
    assert_eq!(picture(&flat(0.0, 1e-30), &config(&[View::Top])), near);
    assert!(share(&picture(&flat(0.0, 1e30), &config(&[View::Top]))) > 0.3);
    // Seen from its edge it has no area.
    assert_eq!(share(&picture(&flat(0.0, 64.0), &config(&[View::Front]))), 0.0);
    assert_eq!(share(&picture(&flat(5.0, 0.0), &config(&[View::Iso]))), 0.0);
}

#[test]
fn backs_have_another_tint_and_edges_are_dark() {
    let front = [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]];
    let middle = |picture: &Picture| picture.pixel(26, 28);
    let [top, bottom] = [View::Top, View::Bottom].map(|view| picture(&front, &config(&[view])));
    let [red, _, blue] = middle(&top);
    assert!(red >= blue, "{red} {blue}");
    let [red, _, blue] = bottom.pixel(26, 20);
    assert!(red < blue, "{red} {blue}");
    let wire = picture(&front, &Config { edges: Edges::Drawn, ..config(&[View::Top]) });
    assert_eq!(middle(&wire), middle(&top));
    let darkest = |picture: &Picture| (0..64).map(|column| picture.pixel(column, 30)[0]).min();
    assert!(darkest(&wire).unwrap() + 30 < darkest(&top).unwrap(), "{:?}", darkest(&wire));
}

#[test]
fn colours_of_vertices_are_shown() {
    let corner = |x: f32, y: f32| ColoredPoint { position: [x, y, 0.0], color: [20, 200, 20, 255] };
    let triangle = Triangle([corner(0.0, 0.0), corner(1.0, 0.0), corner(0.0, 1.0)]);
    let outcome = rendered(&[triangle], &config(&[View::Top]), &Monitor::silent()).unwrap();
    let [red, green, blue] = outcome.picture.pixel(26, 28);
    assert!(green > 120 && red < 60 && blue < 60, "{red} {green} {blue}");
    assert_eq!(outcome.triangles, 1);
}

#[test]
fn nothing_has_no_picture() {
    let error = rendered(&plain(&[]), &config(&[View::Iso]), &Monitor::silent()).err().unwrap();
    assert!(matches!(error, Error::Request(_)), "{error}");
}

#[test]
fn a_picture_can_be_cancelled_while_it_is_measured_and_drawn() {
    for at in [StageId::Import, StageId::Render] {
        let cancel = Cancel::default();
        let raise = |event: &Event| match event {
            Event::Started { stage, .. } if *stage == at => cancel.raise(),
            _ => {}
        };
        let monitor = Monitor { observer: &raise, cancel: cancel.clone() };
        let triangles = plain(&sphere(1.0, 20));
        let error = rendered(&triangles, &config(&[View::Iso]), &monitor).err().unwrap();
        assert!(matches!(error, Error::Cancelled(by) if by.0 == at), "{error}");
    }
}

#[test]
fn a_picture_is_a_png_that_others_can_read() {
    let picture = picture(&sphere(3.0, 60), &config(&[View::Iso, View::Top]));
    let mut bytes = Vec::new();
    picture.write_png(&mut bytes).unwrap();
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
    let mut decoded = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut decoded).unwrap();
    assert_eq!((info.width, info.height, info.color_type), (64, 48, png::ColorType::Rgb));
    let expected = (0..48).flat_map(|row| (0..64).map(move |column| (column, row)));
    let expected = expected.flat_map(|(column, row)| picture.pixel(column, row));
    assert!(expected.eq(decoded));
}

#[test]
fn text_is_cut_off_at_the_border() {
    let mut picture = Picture::new(30, 8, [255; 3]);
    let text = Text { text: "Li\u{e9}", color: [0; 3], dot: 1 };
    assert_eq!((text.width(), text.height()), (18, 7));
    picture.write(20, 3, text);
    assert_eq!(picture.pixel(20, 3), [0; 3]);
    assert_eq!(picture.pixel(21, 3), [255; 3]);
}
