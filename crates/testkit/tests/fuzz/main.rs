//! Fuzzing of every reader of files: an answer or an error, within a bound of memory and time, never a panic.
//!
//! Without settings each reader gets the same few hundred damaged files every time. The long form goes by the
//! processor's time, in turns, and prints a row a reader for the table of docs/RELIABILITY.md:
//!
//! ```sh
//! FOOTFALL_FUZZ_SECONDS=600 cargo test --release -p testkit --test fuzz -- --nocapture
//! ```
//!
//! `FOOTFALL_FUZZ_READERS=geotiff,off` takes some of them or one, `FOOTFALL_FUZZ_SEED` other files. What breaks a
//! promise is told at once and kept in `target/fuzz`.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

mod mutate;
mod readers;
mod run;

#[global_allocator]
static HEAP: peak_alloc::PeakAlloc = peak_alloc::PeakAlloc;

/// Damaged files for each reader where no time is given.
const INPUTS: u64 = 400;
/// One turn of a reader in the long form (s of the processor).
const TURN_S: f64 = 20.0;

// The only test of its program: what it counts is of the whole process.
#[test]
fn every_reader_answers_damaged_files_within_its_bounds() {
    let setting = |name: &str| std::env::var(name).ok();
    let seconds: Option<f64> = setting("FOOTFALL_FUZZ_SECONDS").map(|s| s.parse().unwrap());
    let seed: u64 = setting("FOOTFALL_FUZZ_SEED").map_or(1, |s| s.parse().unwrap());
    let wanted = setting("FOOTFALL_FUZZ_READERS");
    let is_wanted = |name: &str| wanted.as_ref().is_none_or(|w| w.split(',').any(|w| w == name));
    let readers = readers::all().into_iter().filter(|r| is_wanted(r.name));
    let mut runs: Vec<run::Run> = readers.map(|r| run::Run::new(r, seed)).collect();
    assert!(!runs.is_empty(), "FOOTFALL_FUZZ_READERS names no reader");
    let watch = run::Watch::start();
    for run in &mut runs {
        run.read_good_files();
    }
    match seconds {
        None => runs.iter_mut().for_each(|run| run.inputs(INPUTS, &watch)),
        Some(seconds) => {
            let mut turn = 0.0;
            while turn < seconds {
                turn = (turn + TURN_S).min(seconds);
                for run in &mut runs {
                    run.until(turn, &watch);
                    println!("{}", run.row());
                }
            }
        }
    }
    println!("{}", run::HEAD);
    for run in &runs {
        println!("{}", run.row());
    }
    let broken: Vec<&String> = runs.iter().flat_map(|run| &run.broken).collect();
    assert!(broken.is_empty(), "{broken:#?}");
}
