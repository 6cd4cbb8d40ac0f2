//! `footfall rover-sim`.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use bridge::carrier::Bounds;
use bridge::carrier::host::{self, RoverHost};
use bridge::carrier::journal::{Journal, Memory};
use bridge::clock::{Clock, SystemClock};
use bridge::sim_adapter::SimAdapter;
use clap::Args;
use rover::Robot;
use sim::SimRover;
use terrain::ElevationMap;
use wire::check::{At, RequestError};
use wire::convert;
use wire::time::Timestamp;

use super::run_server::{SiteArgs, begin_messages, mission};
use super::{Failure, Output, Verdict};
use crate::live::hash_text;
use crate::robots::Robots;
use crate::serve::{self, Mission, StartError};
use crate::terrain_store::version_name;
use crate::world;

/// The simulated rover, and where it listens.
#[derive(Debug, Args)]
pub(super) struct RoverSimArgs {
    #[command(flatten)]
    site: SiteArgs,
    /// Address to listen on for a ground: loopback only, for whoever connects commands the rover. Port 0
    /// takes any free one.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:7400")]
    listen: SocketAddr,
    /// Folder of the rover's memory: where it is, what it was told. It survives the process.
    #[arg(long, value_name = "DIR", default_value = "rover-state")]
    state: PathBuf,
}

/// The rover on its ground: where it was when it ended, or seated anew.
fn rover(
    mission: &Mission,
    robot: &Arc<Robot>,
    map: &ElevationMap,
    memory: &Memory,
) -> Result<SimRover, Failure> {
    let config = &mission.config;
    let gravity = config.rover.gravity_m_s2;
    if let Some(place) = &memory.place {
        let scene = collision::Scene::new(robot.clone(), map.clone(), &[])
            .map_err(|error| Failure::Fault(error.to_string()))?;
        let at = convert::configuration(&At::root("state"), robot, &place.state)?;
        match SimRover::new(scene, at, gravity) {
            Ok(rover) => return Ok(rover),
            Err(why) => {
                tracing::warn!("the rover cannot stand where it was, so it is placed anew: {why}")
            }
        }
    }
    let (heading, pose) = (config.rover.heading_rad, &config.rover.pose);
    let (rover, settled) = world::seat(robot, map, gravity, mission.place_m, heading, pose)?;
    tracing::info!("the rover stands {:.2} m from the wished place", settled.moved_m);
    Ok(rover)
}

fn begin(args: &RoverSimArgs, now: Timestamp) -> Result<RoverHost, Failure> {
    let mission = mission(&args.site)?;
    let config = Arc::new(mission.config.clone());
    let dirs = Some(config.server.robots_dir.clone()).filter(|dir| !dir.as_os_str().is_empty());
    let robots = Arc::new(Robots::new(dirs.into_iter().collect()));
    let robot = serve::robot(&config, &robots)?;
    let map = serve::first_map(&config, mission.root.clone())?;
    let hash = hash_text(robot.hash());
    let of = format!("robot {hash} on ground {}", version_name(&map));
    let journal = Journal::open(&args.state, &of, now)
        .map_err(|error| RequestError::new("rover_memory", error.to_string()))?;
    let mut rover = rover(&mission, &robot, &map, journal.memory())?;
    journal.memory().recall(&mut rover);
    let adapter = SimAdapter::new(now, rover).with_silence_max(config.commands.silence_max_s());
    let run = uuid::Uuid::now_v7().to_string();
    Ok(RoverHost::new(now, Box::new(adapter), journal, run, hash, Bounds::default()))
}

pub(super) fn rover_sim(args: &RoverSimArgs, output: Output) -> Result<Verdict, Failure> {
    if !args.listen.ip().is_loopback() {
        let bind = args.listen.ip().to_string();
        return Err(StartError::NotLoopback { bind }.into());
    }
    begin_messages(output);
    let runtime = tokio::runtime::Runtime::new().map_err(|error| {
        Failure::Fault(format!("the program cannot start its threads: {error}"))
    })?;
    runtime.block_on(async {
        let listener = serve::listen(args.listen).await?;
        let address = listener
            .local_addr()
            .map_err(|error| Failure::Fault(format!("the address is unknown: {error}")))?;
        let clock = Arc::new(SystemClock::new());
        let host = begin(args, clock.now())?;
        let shared = host.shared();
        output.say(&format!("the simulated rover is at tcp://{address} (stop it with Ctrl-C)"));
        let host = Arc::new(Mutex::new(host));
        let listening = tokio::spawn(host::listen(shared, listener, clock.clone()));
        let ended = tokio::select! {
            error = host::run(host, clock) => Err(Failure::Fault(error.to_string())),
            () = serve::asked_to_end() => Ok(Verdict::Done),
        };
        listening.abort();
        ended
    })
}
