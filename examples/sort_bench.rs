//! Measures the out-of-core primitives as ratios to a plain copy of the same bytes, in the same
//! minute, in the same folder: `sort_bench FOLDER [sort|merge|pushed|reduce|join]...`.
#![expect(clippy::print_stdout, reason = "a measurement prints its figures")]

use std::{
    fs,
    path::Path,
    time::{Duration, Instant},
};

use meshmill::{
    Result,
    external::{
        Keyed, join, reduce,
        sort::{self, Engine, Sorter},
    },
    progress::{Monitor, StageId},
    soup::Point,
    storage::{Record, RecordFile, RecordWriter, Workspace},
};
use rand_xoshiro::{
    Xoshiro256PlusPlus,
    rand_core::{RngCore, SeedableRng as _},
};
use zerocopy::{FromBytes, Immutable, IntoBytes, KnownLayout};

#[derive(Clone, Copy, FromBytes, IntoBytes, Immutable, KnownLayout)]
#[repr(transparent)]
struct Item<const WORDS: usize>([u64; WORDS]);

impl Record for Item<3> {
    const KIND: [u8; 4] = *b"BEN3";
}

impl Record for Item<9> {
    const KIND: [u8; 4] = *b"BEN9";
}

impl Keyed for Item<3> {
    type Key = u64;

    fn key(&self) -> u64 {
        self.0[0]
    }
}

impl Keyed for Item<9> {
    type Key = u64;

    fn key(&self) -> u64 {
        self.0[0]
    }
}

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().unwrap_or_else(|| ".".to_owned());
    let workspace = Workspace::create(Path::new(&folder))?;
    let names: Vec<String> = arguments.collect();
    let wanted = |name: &str| names.is_empty() || names.iter().any(|other| other == name);
    for name in ["sort", "merge", "pushed", "coherent"].into_iter().filter(|name| wanted(name)) {
        measure_sort(name, &workspace)?;
    }
    if wanted("reduce") {
        measure_reduce(&workspace)?;
    }
    if wanted("join") {
        measure_join(&workspace)?;
    }
    Ok(())
}

const SORT_COUNT: u64 = 60_000_000;
const SORT_MEMORY: u64 = 256 << 20;

fn measure_sort(name: &str, workspace: &Workspace) -> Result<()> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
    let mut key = |i: u64| match name {
        // Each record is at most 65,536 places from where it belongs.
        "coherent" => (i << 20) + random.next_u64() % (1 << 36),
        _ => random.next_u64(),
    };
    let input = written(workspace, SORT_COUNT, |i| Item([key(i), i, 0]))?;
    let copy = copy_time(&input, workspace);
    let engine = if name == "merge" { Engine::Merge } else { Engine::Auto };
    let config =
        sort::Config { stage: StageId::Sort, memory_bytes: SORT_MEMORY, engine, step: None };
    let monitor = Monitor::silent();
    let watch = Stopwatch::start();
    let output = if name == "sort" || name == "merge" {
        sort::sort(input, &config, workspace, &monitor)?
    } else {
        let mut sorter = Sorter::new(&config, workspace, &monitor);
        let mut scanner = input.scan()?;
        drop(input);
        while let Some(batch) = scanner.next_batch()? {
            sorter.push(batch)?;
        }
        drop(scanner);
        sorter.finish()?
    };
    report(name, SORT_COUNT, watch.stop(), copy, 1);
    assert!(output.read_all()?.is_sorted_by_key(|item| item.0[0]), "the order is wrong");
    Ok(())
}

fn measure_reduce(workspace: &Workspace) -> Result<()> {
    let (runs, each) = (10, 2_000_000);
    let mut random = Xoshiro256PlusPlus::seed_from_u64(2);
    let mut files = Vec::new();
    for _ in 0..runs {
        let mut key = 0;
        files.push(written(workspace, each, |_| {
            key += random.next_u64() % 16;
            Item([key, 1, 1, 1, 1, 1, 1, 1, 1])
        })?);
    }
    let copy = copy_time(&files[0], workspace);
    let config = reduce::Config { stage: StageId::Cluster, memory_bytes: 256 << 20 };
    let watch = Stopwatch::start();
    let mut writer = RecordWriter::create(workspace, "sums", None)?;
    reduce::reduce(files, add, &config, workspace, &Monitor::silent(), |r| writer.extend(r))?;
    let sums = writer.finish()?;
    report("reduce", u64::from(runs) * each, watch.stop(), copy, runs);
    let terms: u64 = sums.read_all()?.iter().map(|item| item.0[3]).sum();
    assert_eq!(terms, u64::from(runs) * each, "terms were lost");
    Ok(())
}

fn add(sum: &mut Item<9>, item: &Item<9>) {
    for (sum, term) in sum.0[1..].iter_mut().zip(&item.0[1..]) {
        *sum = sum.wrapping_add(*term);
    }
}

fn measure_join(workspace: &Workspace) -> Result<()> {
    let (vertices, triangles) = (5_000_000_u64, 10_000_000_u64);
    let table = written(workspace, vertices, |i| Point([i as f32, (i >> 12) as f32, 0.5]))?;
    let memory_bytes = table.size_bytes() / 10;
    let output = written(workspace, 3 * triangles, |_| Point([0.0; 3]))?;
    let copy = copy_time(&output, workspace);
    drop(output);
    for order in ["local", "random"] {
        let mut random = Xoshiro256PlusPlus::seed_from_u64(3);
        let mut index = |corner: u64| match order {
            "local" => (corner / 6 + random.next_u64() % 2000) % vertices,
            _ => random.next_u64() % vertices,
        };
        let indices: Vec<u64> = (0..3 * triangles).map(&mut index).collect();
        let config = join::Config { stage: StageId::Dereference, memory_bytes };
        let monitor = Monitor::silent();
        let watch = Stopwatch::start();
        let mut join = join::Join::new(table.clone(), &config, workspace, &monitor)?;
        for batch in indices.chunks(1 << 14) {
            join.push(batch)?;
        }
        let pushed = watch.stop();
        let output = join.finish()?;
        report(&format!("join {order}"), triangles, watch.stop(), copy, 1);
        println!("  of which pushing {:.2} s", pushed.clock.as_secs_f64());
        let values = output.read_all()?;
        assert!(values.iter().zip(&indices).all(|(v, i)| v.0[1] == (i >> 12) as f32), "wrong");
    }
    Ok(())
}

fn written<R: Record>(
    workspace: &Workspace,
    count: u64,
    record: impl FnMut(u64) -> R,
) -> Result<RecordFile<R>> {
    let mut writer = RecordWriter::create(workspace, "input", Some(count))?;
    let mut batch = Vec::new();
    let mut records = (0..count).map(record);
    loop {
        batch.clear();
        batch.extend(records.by_ref().take(1 << 14));
        if batch.is_empty() {
            return writer.finish();
        }
        writer.extend(&batch)?;
    }
}

/// Time by the clock, and by the processors that worked: on a machine with other work the first
/// says little, and the second, shared by two threads, is what a quiet one would need.
#[derive(Clone, Copy)]
struct Spent {
    clock: Duration,
    processor: Duration,
}

struct Stopwatch(Instant, Duration);

impl Stopwatch {
    fn start() -> Self {
        Self(Instant::now(), processor_time())
    }

    fn stop(&self) -> Spent {
        Spent { clock: self.0.elapsed(), processor: processor_time().saturating_sub(self.1) }
    }
}

/// Of this process and the children it has waited for: fields 14 to 17, in hundredths.
fn processor_time() -> Duration {
    let stat = fs::read_to_string("/proc/self/stat").expect("Linux tells");
    let fields = stat.rsplit(')').next().expect("there is a last part").split_whitespace();
    let ticks = fields.skip(11).take(4).map(|ticks| ticks.parse::<u64>().expect("a number"));
    Duration::from_millis(10 * ticks.sum::<u64>())
}

/// The best of three copies by `cp`, all in the page cache.
fn copy_time<R: Record>(file: &RecordFile<R>, workspace: &Workspace) -> Spent {
    let target = workspace.path().join("copy");
    let times = (0..3).map(|_| {
        let watch = Stopwatch::start();
        let copied = std::process::Command::new("cp")
            .args(["--reflink=never", "--sparse=never"])
            .args([file.path(), &target])
            .status();
        let spent = watch.stop();
        assert!(copied.is_ok_and(|status| status.success()), "cp failed");
        fs::remove_file(&target).expect("the copy can be removed");
        spent
    });
    times.min_by_key(|spent| spent.clock).expect("three copies were made")
}

fn report(name: &str, count: u64, spent: Spent, copy: Spent, copies: u32) {
    let seconds = |duration: Duration| duration.as_secs_f64();
    let (clock, processor) = (seconds(spent.clock), seconds(spent.processor));
    let copy_clock = seconds(copy.clock) * f64::from(copies);
    let copy_processor = seconds(copy.processor) * f64::from(copies);
    let ratio = clock / copy_clock;
    let ratio_processor = processor / 2.0 / copy_processor;
    let speed = count as f64 / clock / 1e6;
    println!("{name}: {clock:.2} s ({speed:.1} M/s), cp {copy_clock:.2} s, ratio {ratio:.2}");
    let status = fs::read_to_string("/proc/self/status").expect("Linux tells");
    let peak = status.lines().find(|line| line.starts_with("VmHWM")).unwrap_or_default();
    println!("  {peak} (of all measurements so far)");
    println!(
        "  processors: {processor:.2} s, cp {copy_processor:.2} s, ratio on two threads {ratio_processor:.2}"
    );
}
