//! Measures what an order costs, beside merely reading the same triangles, in the same minute:
//! `presort_bench FOLDER MESH MEMORY_MIB [read|measure|absorb|sort]...`; a workspace is made in the
//! folder.
#![expect(clippy::print_stdout, reason = "a measurement prints its figures")]

use std::{path::Path, time::Instant};

use meshmill::{
    Error, Result,
    formats::{OnDefect, Origin},
    progress::{Monitor, StageId},
    soup::{Input, InputPath, Point, Source, SweepAxis, for_each_in_order},
    stages::convert::{
        import::{self, Need},
        presort::{self, Config, Method},
    },
    storage::{Budget, Workspace},
};

/// Times each way is measured; the median counts.
const ROUNDS: usize = 5;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, mesh, mebibytes, wanted @ ..] = arguments.as_slice() else {
        return Err(Error::Request("presort_bench FOLDER MESH MEMORY_MIB".to_owned()));
    };
    let mebibytes: u64 = mebibytes.parse().map_err(|_| Error::Request("how many?".to_owned()))?;
    let budget = Budget::new(mebibytes << 20);
    let workspace = Workspace::create(Path::new(folder))?.with_budget(budget);
    let (path, on_defect) = (InputPath::File(mesh.into()), OnDefect::Fail);
    let input = Input { path, format: None, on_defect, origin: Origin::undecided() }.open()?;
    let config = import::Config { need: Need::Triangles, table_share: 0.9 };
    let imported = import::import::<Point>(vec![input], &config, &workspace, &Monitor::silent())?;
    measure(&imported.source, &workspace, wanted)
}

fn measure(source: &Source<Point>, workspace: &Workspace, wanted: &[String]) -> Result<()> {
    let monitor = Monitor::silent();
    let (order, _) = presort::measure_order(source, workspace, &monitor, |_| false)?;
    println!("late by at most {order:?} along x, y, z");
    let memory_bytes = workspace.budget().limit_bytes();
    let (axis, displacement_max) = (SweepAxis::Z, order.displacement_max[2]);
    let sort = |method| -> Result<u64> {
        let config = Config { axis, method, memory_bytes, steps: None };
        Ok(presort::presort(source, &config, workspace, &monitor, |_| Ok(()))?.triangles)
    };
    let read = || -> Result<u64> {
        let (meter, mut triangles) = (monitor.meter(StageId::Sort, None), 0);
        for_each_in_order(
            source,
            &meter,
            workspace.budget(),
            |taken, count| *count = taken.triangles.len() as u64,
            |count: &mut u64| {
                triangles += *count;
                Ok(())
            },
        )?;
        Ok(triangles)
    };
    let absorb = || sort(Method::Absorb { displacement_max });
    let sorted = || sort(Method::Sort);
    let order = || {
        let measured = presort::measure_order(source, workspace, &monitor, |_| false);
        measured.map(|(order, _)| order.displacement_max[2])
    };
    let ways: [(&str, &dyn Fn() -> Result<u64>); 4] =
        [("read", &read), ("measure", &order), ("absorb", &absorb), ("sort", &sorted)];
    let mut seconds = [const { Vec::new() }; 4];
    for _ in 0..ROUNDS {
        for ((name, way), seconds) in ways.iter().zip(&mut seconds) {
            if !wanted.is_empty() && !wanted.iter().any(|wanted| wanted == name) {
                continue;
            }
            let start = Instant::now();
            way()?;
            seconds.push(start.elapsed().as_secs_f64());
        }
    }
    for ((name, _), seconds) in ways.iter().zip(&mut seconds) {
        seconds.sort_by(f64::total_cmp);
        if let Some(median) = seconds.get(ROUNDS / 2) {
            println!("{name:8} {median:.3} s");
        }
    }
    Ok(())
}
