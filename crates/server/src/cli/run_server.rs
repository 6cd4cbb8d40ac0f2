//! `footfall serve`.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bridge::clock::SystemClock;
use clap::Args;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use wire::check::{self, At, RequestError};

use super::{Common, Failure, Output, Verdict};
use crate::config::Config;
use crate::serve::{self, Mission, Server, StartError};
use crate::terrains::FileRoot;

/// The rover, and the ground that it stands on.
#[derive(Debug, Args)]
pub(super) struct SiteArgs {
    /// The demo mission: the simulated rover on synthetic ground. It is the mission as long as no
    /// --config names another.
    #[arg(long, conflicts_with = "config")]
    demo: bool,
    /// Start on this terrain file (GeoTIFF or .off) instead of the configured ground.
    #[arg(long, value_name = "FILE")]
    terrain: Option<PathBuf>,
    /// Take only a square of this side (m) from the middle of the terrain file.
    #[arg(long, value_name = "M")]
    crop_m: Option<f64>,
    /// Middle of the square taken: x,y from the file's lower left corner (m).
    #[arg(long, value_name = "X,Y", value_delimiter = ',', num_args = 1)]
    crop_center_m: Vec<f64>,
    /// Add generated foot-scale detail of this resolution (m) to the terrain file; the map is then
    /// marked as synthetic.
    #[arg(long, value_name = "M")]
    detail_m: Option<f64>,
    /// Seed of synthetic ground and of added detail.
    #[arg(long)]
    seed: Option<u64>,
    /// Where the rover is to stand: x,y (m); the middle of a terrain file where absent.
    #[arg(
        long,
        value_name = "X,Y",
        value_delimiter = ',',
        num_args = 1,
        allow_hyphen_values = true
    )]
    place_m: Vec<f64>,
    /// Factor on every length of the robot.
    #[arg(long)]
    scale: Option<f64>,
    /// Folder of the terrain files that may be imported.
    #[arg(long, value_name = "DIR")]
    terrains: Option<PathBuf>,
    #[command(flatten)]
    common: Common,
}

/// What to serve, and where.
#[derive(Debug, Args)]
pub(super) struct ServeArgs {
    #[command(flatten)]
    site: SiteArgs,
    /// Port to listen on; 0 takes any free one.
    #[arg(long)]
    port: Option<u16>,
    /// Address to listen on: loopback only, until there are accounts.
    #[arg(long)]
    bind: Option<String>,
    /// Folder of the flight logs.
    #[arg(long, value_name = "DIR")]
    logs: Option<PathBuf>,
    /// A rover that is a process of its own, as `footfall rover-sim` on the same ground: tcp://host:port.
    /// Without it the simulated rover runs within the server.
    #[arg(long, value_name = "ADDRESS")]
    rover: Option<String>,
}

impl From<StartError> for Failure {
    fn from(error: StartError) -> Failure {
        let message = error.to_string();
        match error {
            StartError::Mission(error) => {
                let RequestError { code, field, .. } = error;
                RequestError { code, field, message }.into()
            }
            StartError::NotLoopback { .. } => RequestError::new("bind_refused", message).into(),
            StartError::PortInUse { .. } => RequestError::new("port_in_use", message).into(),
            StartError::Listen { .. } => RequestError::new("listen", message).into(),
            StartError::Log { .. } => RequestError::new("log_unavailable", message).into(),
        }
    }
}

/// The configured mission with the changes of the command line.
pub(super) fn mission(args: &SiteArgs) -> Result<Mission, Failure> {
    let Mission { mut config, mut root, mut place_m, rover } =
        Mission::of(super::analyze::config(&args.common)?);
    let pair = |name: &str, values: &[f64]| match *values {
        [] => Ok(None),
        [x, y] if x.is_finite() && y.is_finite() => Ok(Some([x, y])),
        _ => {
            let message = format!("{name} takes two numbers with a comma: {name} 10,20");
            Err(Failure::Input(RequestError::new("out_of_range", message)))
        }
    };
    if let Some(path) = &args.terrain {
        let file = path.file_name().map(|name| name.to_string_lossy().into_owned());
        config.terrain.file = file.unwrap_or_default();
        // A file given by hand is taken as it is, and the rover stands in its middle.
        config.terrain.crop_width_m = 0.0;
        config.terrain.detail_resolution_m = 0.0;
        root = FileRoot::Relative(path.parent().map(Path::to_owned).unwrap_or_default());
        place_m = None;
    }
    let on_file = !config.terrain.file.is_empty();
    if !on_file && (args.crop_m.is_some() || args.detail_m.is_some()) {
        let message = "--crop-m and --detail-m go with --terrain FILE";
        return Err(RequestError::new("terrain_ambiguous", message).into());
    }
    config.terrain.crop_width_m = args.crop_m.unwrap_or(config.terrain.crop_width_m);
    if let Some([x, y]) = pair("--crop-center-m", &args.crop_center_m)? {
        (config.terrain.crop_x_m, config.terrain.crop_y_m) = (x, y);
    }
    config.terrain.detail_resolution_m =
        args.detail_m.unwrap_or(config.terrain.detail_resolution_m);
    config.terrain.seed = args.seed.unwrap_or(config.terrain.seed);
    place_m = pair("--place-m", &args.place_m)?.or(place_m);
    if let Some(scale) = args.scale {
        rescale(&mut config, scale)?;
    }
    config.server.terrain_dir = args.terrains.clone().unwrap_or(config.server.terrain_dir);
    if let Some(robots) = args.common.robots.first() {
        config.server.robots_dir = robots.clone();
    }
    Ok(Mission { config, root, place_m, rover })
}

/// The configured rover at another scale, with the lengths of its payload and of its foot: masses
/// stay, as those of the robot do.
fn rescale(config: &mut Config, scale: f64) -> Result<(), Failure> {
    check::within(&At::root("--scale"), scale, [0.001, 1000.0], "")?;
    let (rover, foot) = (&mut config.rover, &mut config.traversability);
    let factor = scale / rover.scale;
    rover.scale = scale;
    for length in [
        &mut foot.footprint_m,
        &mut foot.roughness_lo_m,
        &mut foot.roughness_hi_m,
        &mut foot.step_lo_m,
        &mut foot.step_hi_m,
        &mut rover.payload_x_m,
        &mut rover.payload_y_m,
        &mut rover.payload_z_m,
        &mut rover.payload_box_x_m,
        &mut rover.payload_box_y_m,
        &mut rover.payload_box_z_m,
    ] {
        *length *= factor;
    }
    Ok(())
}

/// The host and port of tcp://host:port.
fn rover_address(text: &str) -> Result<String, Failure> {
    let address = text.strip_prefix("tcp://").map(|rest| rest.trim_end_matches('/'));
    let good = address.and_then(|address| {
        let (host, port) = address.rsplit_once(':')?;
        (!host.is_empty() && port.parse::<u16>().is_ok_and(|port| port > 0)).then_some(address)
    });
    good.map(str::to_owned).ok_or_else(|| {
        let shown: String = text.chars().take(80).collect();
        let message = format!("--rover {shown} is no address of a rover; it takes tcp://host:port");
        RequestError::new("rover_address_invalid", message).into()
    })
}

/// Begins to tell what happens, on standard error.
pub(super) fn begin_messages(output: Output) {
    let filter = if output.quiet { "error" } else { "info,tower_http=warn" };
    let filter = EnvFilter::try_from_env("FOOTFALL_LOG").unwrap_or_else(|_| filter.into());
    let layer = tracing_subscriber::fmt::layer()
        .with_ansi(std::io::stderr().is_terminal())
        .with_writer(std::io::stderr);
    let filter = crate::log_level::changeable(filter);
    tracing_subscriber::registry().with(filter).with(layer).init();
}

pub(super) fn serve(args: &ServeArgs, output: Output) -> Result<Verdict, Failure> {
    let mut mission = mission(&args.site)?;
    let server = &mut mission.config.server;
    server.port = args.port.unwrap_or(server.port);
    server.bind = args.bind.clone().unwrap_or(std::mem::take(&mut server.bind));
    server.logs_dir = args.logs.clone().unwrap_or(std::mem::take(&mut server.logs_dir));
    mission.rover = args.rover.as_deref().map(rover_address).transpose()?;
    let address = serve::address(&mission.config)?;
    begin_messages(output);
    let runtime = tokio::runtime::Runtime::new().map_err(|error| {
        Failure::Fault(format!("the program cannot start its threads: {error}"))
    })?;
    runtime.block_on(async {
        // The port first: it is what most often fails, and the log begins only with it.
        let listener = serve::listen(address).await?;
        let address = listener
            .local_addr()
            .map_err(|error| Failure::Fault(format!("the address is unknown: {error}")))?;
        let clock = Arc::new(SystemClock::new());
        let server = tokio::task::spawn_blocking({
            let handle = tokio::runtime::Handle::current();
            move || {
                let _runtime = handle.enter();
                Server::start(mission, clock)
            }
        })
        .await
        .map_err(|error| Failure::Fault(format!("the server did not start: {error}")))??;
        output.say(&format!("FootFall is at http://{address}/ (stop it with Ctrl-C)"));
        server.run(listener, serve::asked_to_end()).await;
        Ok::<_, Failure>(())
    })?;
    // Work that was told to stop may still be on its way out; it holds nothing up.
    runtime.shutdown_background();
    Ok(Verdict::Done)
}
