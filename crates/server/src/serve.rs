//! Bringing the ground server up, and down again.

pub mod connections;
mod last_session;

use std::collections::BTreeMap;
use std::future::Future;
use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, PoisonError};
use std::time::Duration;

use bridge::adapter::RoverAdapter;
use bridge::bus::Bus;
use bridge::carrier::{Bounds, RemoteRover};
use bridge::clock::Clock;
use bridge::ground::{self, Ground};
use bridge::recorder::{ChannelSchema, Recorder, RecorderOptions};
use bridge::sim_adapter::SimAdapter;
use bridge::views::{self, VIEWS_HZ, Views};
use rover::Robot;
use stereo::rig::Rig;
use terrain::ElevationMap;
use tokio::net::TcpListener;
use tokio::sync::{Semaphore, watch};
use utoipa::PartialSchema;
use wire::check::{At, RequestError};
use wire::live::{
    CommandEvent, EventLevel, EventNotice, ImageReceived, JobReport, LinkReport, LogGap,
    PlanRecord, ReachSummary, RoverTelemetry, StabilityDerived, TerrainNotice, Uplink, channel,
};
use wire::reconstruction::MapRecord;
use wire::scene::Scene as WireScene;

use crate::analyses::Site;
use crate::app::{App, AppState};
use crate::config::Config;
use crate::drape::Overlays;
use crate::gate::Gate;
use crate::imaging;
use crate::jobs::Jobs;
use crate::live::{Live, LiveParts, derive_for, hash_text};
use crate::live_reach::{self, LiveReach};
use crate::plans::{Plans, Postures};
use crate::reconstruction::{Reconstructions, contact, restore};
use crate::replays::Replays;
use crate::robots::Robots;
use crate::scene::Context;
use crate::terrain_store::{TerrainStore, source_text, version_name};
use crate::terrains::{FileRoot, Terrains};
use crate::{api, world};

/// Messages kept on the bus for slow listeners.
const BUS_CAPACITY: usize = 4096;
/// Connections get this long to end when the server does.
const FAREWELL: Duration = Duration::from_secs(3);

/// Why the server does not start. Each is one sentence.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// Another address than loopback.
    #[error(
        "{bind} is not a loopback address; until there are accounts the server listens on 127.0.0.1 or ::1 only, so reach it through an SSH tunnel"
    )]
    NotLoopback {
        /// The address.
        bind: String,
    },
    /// The port is taken.
    #[error(
        "port {port} is in use by another program; stop that one or choose another with --port"
    )]
    PortInUse {
        /// The port.
        port: u16,
    },
    /// The port cannot be had for another reason.
    #[error("the server cannot listen on {address}: {reason}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// Why.
        reason: String,
    },
    /// Robot, ground or place of the configuration.
    #[error("the mission cannot begin: {0}")]
    Mission(#[from] RequestError),
    /// No flight log.
    #[error("the flight log cannot be written in {folder}: {reason}")]
    Log {
        /// The folder.
        folder: String,
        /// Why.
        reason: String,
    },
}

/// What to start with.
#[derive(Debug, Clone, PartialEq)]
pub struct Mission {
    /// Settings.
    pub config: Config,
    /// Where the terrain file of the settings is looked for.
    pub root: FileRoot,
    /// Where the rover is to stand (m); the middle of the map where there is none.
    pub place_m: Option<[f64; 2]>,
    /// Where a rover that is a process of its own listens, as host:port; the simulated rover runs in
    /// this one where absent.
    pub rover: Option<String>,
}

impl Mission {
    /// The mission of a configuration as it is.
    pub fn of(config: Config) -> Mission {
        let root = FileRoot::Folder(config.server.terrain_dir.clone());
        let place_m = Some([config.rover.place_x_m, config.rover.place_y_m]);
        Mission { config, root, place_m, rover: None }
    }
}

/// What is served, and what must be driven and ended with it.
pub struct Server {
    /// Everything that the routes share.
    pub app: AppState,
    driver: tokio::task::JoinHandle<()>,
    reach: tokio::task::JoinHandle<()>,
    contacts: tokio::task::JoinHandle<()>,
    /// Dials a rover that is a process of its own.
    dialer: Dialer,
    closing: watch::Sender<bool>,
}

/// The address of a configuration: loopback, or refused.
pub fn address(config: &Config) -> Result<SocketAddr, StartError> {
    let bind = &config.server.bind;
    let ip: Option<IpAddr> = match bind.as_str() {
        "localhost" => Some(IpAddr::from([127, 0, 0, 1])),
        other => other.trim_matches(['[', ']']).parse().ok(),
    };
    match ip {
        Some(ip) if ip.is_loopback() => Ok(SocketAddr::new(ip, config.server.port)),
        _ => Err(StartError::NotLoopback { bind: bind.clone() }),
    }
}

/// Takes the port.
pub async fn listen(address: SocketAddr) -> Result<TcpListener, StartError> {
    TcpListener::bind(address).await.map_err(|error| match error.kind() {
        std::io::ErrorKind::AddrInUse => StartError::PortInUse { port: address.port() },
        _ => StartError::Listen { address, reason: error.to_string() },
    })
}

impl Server {
    /// Makes the ground, seats the simulated rover on it, and begins a flight log.
    pub fn start(mission: Mission, clock: Arc<dyn Clock>) -> Result<Server, StartError> {
        let Mission { config, root, place_m, rover } = mission;
        let now = clock.now();
        let dirs = Some(config.server.robots_dir.clone());
        let dirs = dirs.filter(|dir| !dir.as_os_str().is_empty());
        let robots = Arc::new(Robots::new(dirs.into_iter().collect()));
        let config = Arc::new(config);
        let map = first_map(&config, root)?;
        let limits = config.traversability.limits();
        let footprint_m = config.traversability.footprint_m;
        let n_versions = config.server.terrain_versions_max;
        let store = TerrainStore::new(map.clone(), now, footprint_m, limits, n_versions);
        let store = Arc::new(store.doubting(config.traversability.doubt_sigmas));
        if let Err(error) = store.current().layers() {
            tracing::warn!("{error}");
        }
        let folder = FileRoot::Folder(config.server.terrain_dir.clone());
        let terrains = Arc::new(Terrains::new(folder, Some(store.clone())));
        let (live, dialer, earlier) = live(&config, place_m, rover, &robots, &map, clock.clone())?;
        let (closing, closed) = watch::channel(false);
        let publish = live.ground.clone();
        let publish_clock = clock.clone();
        let jobs = Jobs::new(
            config.server.jobs_max,
            Box::new(move |report: &JobReport| {
                let mut ground = publish.lock().unwrap_or_else(PoisonError::into_inner);
                ground.publish(publish_clock.now(), channel::JOB, report);
            }),
        );
        let driver = tokio::spawn(ground::run(live.ground.clone(), clock.clone()));
        let overlays_dir = config.server.terrain_dir.clone();
        let ground_map = map.clone();
        let app = Arc::new(App {
            gate: Gate::new(config.server.analyses_max, config.server.analyses_waiting_max),
            listeners: Arc::new(Semaphore::new(config.server.listeners_max)),
            replays: Replays::new(config.server.replays_max),
            plans: Plans::default(),
            schemas: schemas(),
            postures: Postures::default(),
            config,
            clock,
            robots,
            terrains,
            store,
            live,
            overlays: Overlays::new(overlays_dir, version_name(&map)),
            reconstructions: Reconstructions::new(map),
            reach: LiveReach::default(),
            jobs,
            closing: closed,
        });
        let reach = tokio::spawn(live_reach::run(app.clone()));
        let contacts = tokio::spawn(contact::run(app.clone()));
        let with_overlays = app.clone();
        tokio::task::spawn_blocking(move || bring_back_overlays(&with_overlays, &ground_map));
        if let Some(log) = earlier {
            tokio::spawn(restore::of_last_session(app.clone(), log));
        }
        Ok(Server { app, driver, reach, contacts, dialer, closing })
    }

    /// Serves until `end` completes; then lets go of everybody and finishes the flight log.
    pub async fn run(self, listener: TcpListener, end: impl Future<Output = ()> + Send + 'static) {
        let router = api::router(self.app.clone());
        let closed = self.app.closing.clone();
        let mut serving = tokio::spawn(connections::serve(listener, router, closed));
        tokio::select! {
            () = end => {}
            ended = &mut serving => tracing::error!("the server ended by itself: {ended:?}"),
        }
        // No receiver left is no error.
        let _ = self.closing.send(true);
        self.app.jobs.cancel_all();
        if !serving.is_finished() && tokio::time::timeout(FAREWELL, &mut serving).await.is_err() {
            serving.abort();
        }
        self.finish().await;
    }

    /// Ends the session: the flight log gets its end and is synced.
    pub async fn finish(self) {
        self.driver.abort();
        self.reach.abort();
        self.contacts.abort();
        if let Some(dialer) = &self.dialer {
            dialer.abort();
        }
        let ground = self.app.live.ground.clone();
        let clock = self.app.clock.clone();
        let finish = move || {
            let mut ground: std::sync::MutexGuard<'_, Ground> =
                ground.lock().unwrap_or_else(PoisonError::into_inner);
            ground.finish(clock.now())
        };
        match tokio::task::spawn_blocking(finish).await {
            Ok(Ok(status)) => {
                tracing::info!("flight log {} holds {} messages", status.log.id, status.messages);
            }
            Ok(Err(error)) => tracing::error!("the flight log was not finished: {error}"),
            Err(error) => tracing::error!("the flight log was not finished: {error}"),
        }
    }
}

/// The rasters that the server before had laid over the same ground; told as far as there were any.
fn bring_back_overlays(app: &AppState, map: &ElevationMap) {
    let (n, failed) = app.overlays.bring_back(map);
    if n == 0 && failed.is_empty() {
        return;
    }
    let mut text = format!("{n} rasters lie over the ground as before");
    let level = if failed.is_empty() { EventLevel::Info } else { EventLevel::Caution };
    for why in failed {
        text += &format!("; not back: {why}");
    }
    let (mut ground, now) = app.live.locked();
    ground.notice(now, level, "server", &text);
}

/// The ground that a configuration begins on.
pub(crate) fn first_map(config: &Config, root: FileRoot) -> Result<ElevationMap, RequestError> {
    let import = world::first_import(config);
    if import.file.is_none() {
        let recipe = world::configured_recipe(&config.terrain)?;
        return terrain::synthetic::generate(&recipe, config.terrain.seed)
            .map_err(|error| crate::terrains::terrain_error(&At::root("terrain"), &error));
    }
    world::import_map(&Terrains::new(root, None), &import)
}

/// The robot of a configuration, loaded, scaled and with its payloads.
pub(crate) fn robot(
    config: &Arc<Config>,
    robots: &Arc<Robots>,
) -> Result<Arc<Robot>, RequestError> {
    let scene = WireScene {
        robot: Some(config.rover.robot.clone()),
        scale: Some(config.rover.scale),
        payloads: Some(config.rover.payloads()),
        ..WireScene::default()
    };
    let terrains = Arc::new(Terrains::new(FileRoot::Folder("".into()), None));
    let context = Context { robots: robots.clone(), terrains, config: config.clone(), live: None };
    context.robot(&At::root("rover"), &scene)
}

/// The task that dials a rover that is a process of its own.
type Dialer = Option<tokio::task::JoinHandle<()>>;

/// The live rover of a configuration, seated on its map or dialed, and the log of an earlier session of which the map of
/// the cameras is to be made again.
fn live(
    config: &Arc<Config>,
    place_m: Option<[f64; 2]>,
    address: Option<String>,
    robots: &Arc<Robots>,
    map: &ElevationMap,
    clock: Arc<dyn Clock>,
) -> Result<(Live, Dialer, Option<String>), StartError> {
    let now = clock.now();
    let robot = robot(config, robots)?;
    let rig = Arc::new(imaging::rig(&At::root("rover"), robots, &config.rover.robot, &robot)?);
    let gravity = config.rover.gravity_m_s2;
    let notice = TerrainNotice {
        version: version_name(map),
        source: source_text(map),
        synthetic_detail: map.source().synthetic_detail,
    };
    let (adapter, dialer, where_it_is): (Box<dyn RoverAdapter>, _, _) = match address {
        None => {
            let (heading, pose) = (config.rover.heading_rad, &config.rover.pose);
            let (rover, settled) = world::seat(&robot, map, gravity, place_m, heading, pose)?;
            let text = format!(
                "the rover stands {:.2} m from the wished place, margin {:.2} m",
                settled.moved_m, settled.margin_m
            );
            let silence_max_s = config.commands.silence_max_s();
            let adapter = SimAdapter::new(now, rover)
                .with_silence_max(silence_max_s)
                .with_cameras(imaging::cameras(&rig));
            (Box::new(adapter), None, text)
        }
        Some(address) => {
            let (run, hash) = (uuid::Uuid::now_v7().to_string(), hash_text(robot.hash()));
            let rover = RemoteRover::new(now, &address, run, hash, Bounds::default());
            let dialer = tokio::spawn(rover.dial(clock.clone()));
            (Box::new(rover), Some(dialer), format!("the rover is at {address}"))
        }
    };
    // Before the new log is begun, which would be the newest.
    let earlier = last_session::read(&config.server.logs_dir);
    let recorder = recorder(config, now, hash_text(robot.hash()), map, &rig)?;
    let friction = config.terrain.friction;
    let derive = derive_for(robot.clone(), Site { gravity, friction });
    let mut ground =
        Ground::new(now, adapter, config.link.clone(), recorder, Bus::new(BUS_CAPACITY), derive)
            .map_err(|error| RequestError::new("out_of_range", error.to_string()))?;
    ground.configure(config.commands.authority_rules(), config.commands.heartbeat_s());
    ground.log_views(Views::new(robot.clone(), VIEWS_HZ));
    ground.log_images(imaging::records(robot.clone(), rig.clone()));
    let unknown = ground.restore(now, earlier.commands);
    if unknown > 0 {
        let text = format!(
            "of {unknown} commands of the last session the outcome is unknown; nothing is sent again: \
             see what telemetry shows, and resolve them"
        );
        ground.notice(now, EventLevel::Warning, "server", &text);
    }
    ground.restore_estop(now, earlier.estop);
    ground.publish(now, channel::TERRAIN, &notice);
    let text = format!("session begins on {}; {where_it_is}", notice.source);
    ground.notice(now, EventLevel::Info, "server", &text);
    if let Some((version, log)) = &earlier.seen_map {
        let text = format!(
            "the map {version}, which cameras had made in the session before, is being made again from the log {log}"
        );
        ground.notice(now, EventLevel::Info, "server", &text);
    }
    let payloads = config.rover.payloads();
    let live = Live::new(LiveParts { ground, clock, robot, rig, payloads, gravity, friction });
    Ok((live, dialer, earlier.seen_map.map(|(_, log)| log)))
}

fn recorder(
    config: &Config,
    now: wire::time::Timestamp,
    model_hash: String,
    map: &ElevationMap,
    rig: &Rig,
) -> Result<Recorder, StartError> {
    let metadata = BTreeMap::from([
        ("program".to_owned(), format!("footfall {}", env!("CARGO_PKG_VERSION"))),
        ("robot".to_owned(), config.rover.robot.clone()),
        ("model_hash".to_owned(), model_hash),
        ("terrain_version".to_owned(), version_name(map)),
        ("terrain_source".to_owned(), source_text(map)),
    ]);
    let options = RecorderOptions {
        start: now,
        metadata,
        schemas: schemas(),
        protobuf: views::channels().into_iter().chain(imaging::channels(rig)).collect(),
        ..RecorderOptions::default()
    };
    Recorder::start(&config.server.logs_dir, options).map_err(|error| StartError::Log {
        folder: config.server.logs_dir.display().to_string(),
        reason: error.to_string(),
    })
}

/// The JSON Schemas of the channels, for readers of the log.
pub fn schemas() -> Vec<ChannelSchema> {
    let components = components();
    let schema = |channel: &str, name: &str, schema: serde_json::Value| {
        let mut schema = inlined(schema, &components, &[]);
        if let Some(object) = schema.as_object_mut() {
            object.insert("title".into(), name.into());
            object.entry("type").or_insert_with(|| "object".into());
        }
        ChannelSchema {
            channel: channel.into(),
            name: format!("footfall.{name}"),
            schema_json: schema.to_string(),
        }
    };
    macro_rules! of {
        ($channel:expr, $name:ident) => {
            schema(
                $channel,
                stringify!($name),
                serde_json::to_value($name::schema()).unwrap_or_default(),
            )
        };
    }
    vec![
        of!(channel::ROVER_STATE, RoverTelemetry),
        of!(channel::ROVER_STABILITY, StabilityDerived),
        of!(channel::ROVER_REACH, ReachSummary),
        of!(channel::COMMAND_UPLINK, Uplink),
        of!(channel::COMMAND_EVENT, CommandEvent),
        of!(channel::LINK, LinkReport),
        of!(channel::TERRAIN, TerrainNotice),
        of!(channel::EVENT, EventNotice),
        of!(channel::IMAGE, ImageReceived),
        of!(channel::MAP, MapRecord),
        of!(channel::PLAN, PlanRecord),
        of!(channel::LOG_GAP, LogGap),
    ]
}

fn components() -> serde_json::Value {
    let document = serde_json::to_value(api::document()).unwrap_or_default();
    document.pointer("/components/schemas").cloned().unwrap_or_default()
}

/// The schema with every reference replaced by what it refers to, for a log stands by itself. What is
/// within itself, as a command in the steps of a sequence, is told as any object there. `within` are the
/// names that it is within.
fn inlined(
    schema: serde_json::Value,
    components: &serde_json::Value,
    within: &[&str],
) -> serde_json::Value {
    use serde_json::Value;
    match schema {
        Value::Object(object) => {
            let name = object.get("$ref").and_then(Value::as_str);
            let name = name.and_then(|path| path.strip_prefix("#/components/schemas/"));
            if let Some(name) = name
                && let Some(target) = components.get(name)
            {
                if within.contains(&name) {
                    return serde_json::json!({ "type": "object" });
                }
                return inlined(target.clone(), components, &[within, &[name]].concat());
            }
            let fields = object.into_iter();
            Value::Object(fields.map(|(k, v)| (k, inlined(v, components, within))).collect())
        }
        Value::Array(items) => {
            Value::Array(items.into_iter().map(|v| inlined(v, components, within)).collect())
        }
        other => other,
    }
}

/// Completes when the program is asked to end: SIGINT or SIGTERM.
pub async fn asked_to_end() {
    use tokio::signal::unix::{SignalKind, signal};
    let interrupt = tokio::signal::ctrl_c();
    match signal(SignalKind::terminate()) {
        Ok(mut terminate) => {
            tokio::select! {
                _ = interrupt => {}
                _ = terminate.recv() => {}
            }
        }
        Err(error) => {
            tracing::warn!("SIGTERM cannot be heard: {error}");
            // An error here leaves no way to be asked, so the program ends.
            let _ = interrupt.await;
        }
    }
}
