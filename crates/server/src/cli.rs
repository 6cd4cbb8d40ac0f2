//! The command line. Results go to standard output, everything else to standard error.
//!
//! Exit status: 0 done, 1 the answer is "no", 2 unusable input, 3 fault.

mod analyze;
mod compare;
mod log;
mod rover_sim;
mod run_server;
mod terrain;

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};
use wire::check::RequestError;
use wire::resources::ErrorBody;

use crate::api;

/// Ground operations for six-legged wheel-on-leg rovers.
#[derive(Debug, Parser)]
#[command(name = "footfall", version, propagate_version = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Say nothing on standard error but errors.
    #[arg(long, global = true)]
    quiet: bool,
    /// Compact JSON on standard output, errors included.
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Ground server with console and simulated rover.
    Serve(run_server::ServeArgs),
    /// The simulated rover as a process of its own, for `footfall serve --rover`.
    RoverSim(rover_sim::RoverSimArgs),
    /// Plan one step of one leg; exit status 1 if there is no plan.
    Plan(analyze::RequestArgs),
    /// Advise on the posture before a leg is lifted, rehearse the loss of legs; exit status 1 if the wish
    /// cannot be met.
    Posture(analyze::RequestArgs),
    /// Support polygons and margins of stances; exit status 1 if none is stable.
    Stability(analyze::RequestArgs),
    /// Where everything is in given states.
    Kinematics(analyze::RequestArgs),
    /// Joint angles for wheel poses; exit status 1 if no target is reachable.
    InverseKinematics(analyze::RequestArgs),
    /// Where legs can stand, and why not elsewhere; exit status 1 if nowhere.
    Reachability(analyze::RequestArgs),
    /// Where a foot can stand on a ground.
    Traversability(analyze::TraversabilityArgs),
    /// Run all planners over the same seeded scenes: success, time, length, clearance.
    Compare(compare::CompareArgs),
    /// Terrain files and synthetic ground.
    #[command(subcommand)]
    Terrain(terrain::TerrainCommand),
    /// Flight logs.
    #[command(subcommand)]
    Log(log::LogCommand),
    /// Print the OpenAPI document of the server.
    Openapi,
}

/// Where robots and settings come from.
#[derive(Debug, Clone, Default, Args)]
struct Common {
    /// Folder of more robot folders; may be given several times.
    #[arg(long, value_name = "DIR")]
    robots: Vec<PathBuf>,
    /// Settings in place of those of the demo.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
}

/// How a run ended.
#[derive(Debug)]
enum Failure {
    /// Unusable input: exit status 2.
    Input(RequestError),
    /// A fault: exit status 3.
    Fault(String),
}

impl From<RequestError> for Failure {
    fn from(error: RequestError) -> Failure {
        if error.code == "internal" {
            return Failure::Fault(error.message);
        }
        Failure::Input(error)
    }
}

/// Is the answer a yes?
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Verdict {
    /// Exit status 0.
    Done,
    /// Exit status 1.
    No,
    /// Exit status 3: done, but something is lost.
    Lossy,
}

/// How to write to standard output and error.
#[derive(Debug, Clone, Copy)]
struct Output {
    quiet: bool,
    json: bool,
}

impl Output {
    /// Writes a result.
    fn result(self, value: &serde_json::Value) -> Result<(), Failure> {
        let text = if self.json { value.to_string() } else { format!("{value:#}") };
        self.text(&(text + "\n"))
    }

    /// Writes text to standard output.
    fn text(self, text: &str) -> Result<(), Failure> {
        let mut out = std::io::stdout().lock();
        match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
            // Who reads only the beginning has what it wants.
            Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
            other => {
                other.map_err(|e| Failure::Fault(format!("the output cannot be written: {e}")))
            }
        }
    }

    /// Says something to people on standard error.
    fn say(self, text: &str) {
        if !self.quiet {
            // Nothing can be said about a standard error that is closed.
            let _ = writeln!(std::io::stderr(), "{text}");
        }
    }

    fn failure(self, failure: &Failure) -> ExitCode {
        let (status, info) = match failure {
            // Out of time is an answer: not yes.
            Failure::Input(error) if error.code == "deadline" => (1, error.info()),
            Failure::Input(error) => (2, error.info()),
            Failure::Fault(message) => (3, RequestError::new("internal", message.as_str()).info()),
        };
        // Errors are told even when quiet; a closed standard error changes nothing.
        let _ = writeln!(std::io::stderr(), "footfall: {}", info.message);
        if self.json {
            let body = serde_json::to_value(ErrorBody { error: info }).unwrap_or_default();
            // The exit status tells it too.
            let _ = self.result(&body);
        }
        ExitCode::from(status)
    }
}

/// Runs the program.
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            // Help and version are results; all else is unusable input.
            let status = if error.use_stderr() { 2 } else { 0 };
            let _ = error.print();
            return ExitCode::from(status);
        }
    };
    let output = Output { quiet: cli.quiet, json: cli.json };
    match run(&cli.command, output) {
        Ok(Verdict::Done) => ExitCode::SUCCESS,
        Ok(Verdict::No) => ExitCode::from(1),
        Ok(Verdict::Lossy) => ExitCode::from(3),
        Err(failure) => output.failure(&failure),
    }
}

/// Whether the command line takes these words, the program's name first; the error says why not.
pub fn understands(words: &[&str]) -> Result<(), String> {
    match Cli::try_parse_from(words) {
        Err(error) if error.use_stderr() => Err(error.to_string()),
        _ => Ok(()),
    }
}

fn run(command: &Command, output: Output) -> Result<Verdict, Failure> {
    match command {
        Command::Serve(args) => run_server::serve(args, output),
        Command::RoverSim(args) => rover_sim::rover_sim(args, output),
        Command::Plan(args) => analyze::plan(args, output),
        Command::Posture(args) => analyze::posture(args, output),
        Command::Stability(args) => analyze::stability(args, output),
        Command::Kinematics(args) => analyze::kinematics(args, output),
        Command::InverseKinematics(args) => analyze::inverse_kinematics(args, output),
        Command::Reachability(args) => analyze::reachability(args, output),
        Command::Traversability(args) => analyze::traversability(args, output),
        Command::Compare(args) => compare::compare(args, output),
        Command::Terrain(command) => terrain::terrain(command, output),
        Command::Log(command) => log::log(command, output),
        Command::Openapi => output.text(&api::document_text()).map(|()| Verdict::Done),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_well_formed() {
        Cli::command().debug_assert();
    }
}
