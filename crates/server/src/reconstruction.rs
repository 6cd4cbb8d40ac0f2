//! From stereo pairs of the live rover to a new version of the map, as a job.
//!
//! The images come from the rover over its link (`request`): the job sends an `image` command as an operator
//! would, and waits for what comes down; or it takes images that are here already. From there on nothing counts
//! but the images received, the posture that came with them, and the settings of the request, so that the
//! same map can be made again from the flight log ([`rebuild`]), byte for byte.
//!
//! Matching, self-mask and rasterizing (`pair`) give a map of each pair; these are blended (`blend`) into one
//! [`Mapper`] that lasts until another ground is imported. A reconstruction that fails or is cancelled
//! leaves it as it was.
//!
//! One runs at a time, on two threads; at half size (512 x 384 px) a pair is matched in about 0.4 s, and work is
//! asked to stop once a row. Memory is that of the images, the points of a pair (about 150 bytes each) and the
//! blended map.

mod blend;
pub mod contact;
pub mod hidden;
mod pair;
pub mod pictures;
pub mod rebuild;
mod request;
pub mod restore;
pub mod versions;

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bytes::Bytes;
use geometry::{Grid, Raster};
use nalgebra::{Point2, Point3};
use rover::Robot;
use stereo::StereoError;
use stereo::rig::{CameraPair, Rig};
use terrain::fusion::{
    AlignSettings, Correction, Input, MapSettings, MapVersion, Mapper, PairDem, RasterizeOptions,
    ReadPolicy,
};
use terrain::{ElevationMap, Source, SourceKind};
use tokio::sync::Semaphore;
use wire::check::{self, At, RequestError};
use wire::live::{EventLevel, FailedPair, RoverTelemetry};
use wire::map_version::{MapRegion, VersionPair, VersionStep};
use wire::reconstruction::{
    CAMERAS_MAX, MapStep, PairProgress, PairStage, REGION_RADIUS_M, ReconstructionAnswer,
    ReconstructionRequest, SCALE, SeenStep, StoodWheel,
};

use crate::app::AppState;
use crate::drape::Shots;
use crate::error::ApiError;
use crate::jobs::JobHandle;
use crate::stop::Stop;
use crate::terrain_store::{source_text, version_name};
use crate::terrains::terrain_error;

pub use blend::PairSource;
pub use pair::PairImages;
use pictures::Pictures;
pub use request::start;

/// Time allowed for a reconstruction (s).
const DEADLINE_S: f64 = 600.0;
/// Distance of nodes where the request names none (m).
const RESOLUTION_DEFAULT_M: f64 = 0.05;
/// Size of images where the request names none.
const SCALE_DEFAULT: f64 = 0.5;
/// Most pairs that one blended map is made of: bounds its memory.
const PAIRS_MAX: usize = 128;
/// Most nodes of the map from before: bounds the memory of the blended one.
const PRIOR_NODES_MAX: f64 = 4e6;
/// Standard deviation of heights of the map from before (m).
const PRIOR_SIGMA_M: f64 = 0.1;
/// Outcomes that can still be asked for.
const ANSWERS_MAX: usize = 64;

/// What lasts between reconstructions.
pub struct Reconstructions {
    place: Arc<Semaphore>,
    kept: Mutex<Kept>,
}

struct Kept {
    /// The ground that the simulated rover stands on.
    ground: ElevationMap,
    /// Counts the grounds.
    n_grounds: u64,
    /// Counts the reconstructions begun: seeds that nobody chose.
    n_begun: u64,
    blended: Option<Blended>,
    /// The same of versions that can be put in use again, newest last.
    states: VecDeque<(String, Blended)>,
    /// Versions that differ from another by contacts of wheels alone, and that other.
    touched: VecDeque<(String, String)>,
    answers: VecDeque<ReconstructionAnswer>,
    pictures: Pictures,
}

/// The map that pairs are blended into.
#[derive(Clone)]
struct Blended {
    mapper: Mapper,
    has_prior: bool,
    next_source: u32,
    /// Names of the pairs by the numbers of their maps.
    names: BTreeMap<u32, String>,
    /// Their left images, for textures.
    shots: Shots,
    /// What is told of them.
    captures: Vec<VersionPair>,
    /// Fits that were found, of pairs whose fit was undone once.
    found: BTreeMap<u32, Correction>,
    /// Does the map from before count where no pair saw ground?
    keep_prior: bool,
    /// The version that it stands for, or goes on from.
    from: Option<String>,
    /// Wheels that it was told of, where they stood.
    stood: Vec<StoodWheel>,
}

impl Reconstructions {
    /// With the ground that the simulated rover stands on.
    pub fn new(ground: ElevationMap) -> Reconstructions {
        let kept = Kept {
            ground,
            n_grounds: 0,
            n_begun: 0,
            blended: None,
            states: VecDeque::new(),
            touched: VecDeque::new(),
            answers: VecDeque::new(),
            pictures: Pictures::default(),
        };
        Reconstructions { place: Arc::new(Semaphore::new(1)), kept: Mutex::new(kept) }
    }

    /// The simulated rover stands on another ground: what was seen of the last one no longer counts.
    pub fn stand_on(&self, ground: ElevationMap) {
        let mut kept = self.locked();
        (kept.ground, kept.blended) = (ground, None);
        kept.states.clear();
        kept.touched.clear();
        kept.n_grounds += 1;
    }

    /// The outcome of a reconstruction.
    pub fn answer(&self, id: &str) -> Result<ReconstructionAnswer, ApiError> {
        let kept = self.locked();
        kept.answers.iter().find(|answer| answer.id == id).cloned().ok_or_else(|| {
            let message = "there is no such reconstruction, or it has not ended, or long ago";
            ApiError::new("reconstruction_unknown", message)
        })
    }

    /// A picture of a pair of one of the last reconstructions, as PNG.
    pub fn picture(&self, id: &str, pair: &str, picture: &str) -> Result<Bytes, ApiError> {
        self.locked().pictures.get(id, pair, picture).ok_or_else(|| {
            let names = pictures::PICTURES.join(", ");
            let message = format!(
                "there is no such picture: they are kept of the last reconstructions, of each pair as {names} .png"
            );
            ApiError::new("picture_unknown", message)
        })
    }

    fn locked(&self) -> MutexGuard<'_, Kept> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The pairs that a request names, each once.
pub fn chosen(rig: &Rig, names: &[String]) -> Result<Vec<CameraPair>, RequestError> {
    let at = At::root("cameras");
    check::not_empty(&at, names.len())?;
    check::at_most(&at, names.len(), CAMERAS_MAX)?;
    let mut pairs: Vec<CameraPair> = Vec::new();
    for (i, name) in names.iter().enumerate() {
        let Some(pair) = rig.pair(name) else {
            let name: String = name.chars().take(64).collect();
            let known: Vec<&str> = rig.pairs().iter().map(|pair| pair.name.as_str()).collect();
            let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
            let text = format_args!("names the pair {name:?}; the robot has {known}");
            return Err(RequestError::at("camera_unknown", &at.index(i), text));
        };
        if pairs.iter().all(|other| other.name != pair.name) {
            pairs.push(pair.clone());
        }
    }
    Ok(pairs)
}

/// A reconstruction, checked.
struct Work {
    robot: Arc<Robot>,
    rig: Arc<Rig>,
    ground: ElevationMap,
    n_grounds: u64,
    resolution_m: f64,
    scale: f64,
    region: Option<MapRegion>,
    seed: u64,
    keep_prior: bool,
    blended: Blended,
}

/// Where the wheels that bear the rover touch the ground (m).
pub fn standing(frame: &RoverTelemetry) -> Vec<Point3<f64>> {
    let bears = |leg: &str| frame.contacts.get(leg) == Some(&true);
    let points = frame.contact_points_m.iter().filter(|(leg, _)| bears(leg));
    points.map(|(_, p)| Point3::from(*p)).collect()
}

/// Refuses a region or sizes of single pairs that cannot be.
fn check_parts(request: &ReconstructionRequest, pairs: &[CameraPair]) -> Result<(), RequestError> {
    let at = At::root("scales");
    for (name, scale) in &request.scales {
        if pairs.iter().all(|pair| pair.name != *name) {
            let name: String = name.chars().take(64).collect();
            let text = format_args!("names the pair {name:?}, which is not among `cameras`");
            return Err(RequestError::at("camera_unknown", &at, text));
        }
        check::within(&at.field(name), *scale, SCALE, "")?;
    }
    if let Some(region) = &request.region {
        let at = At::root("region");
        check::within(&at.field("radius_m"), region.radius_m, REGION_RADIUS_M, " m")?;
        let [x, y] = region.center_m;
        check::position(&at.field("center_m"), [x, y, 0.0])?;
    }
    Ok(())
}

/// The blended map to go on from.
fn begin(
    kept: &Kept,
    request: &ReconstructionRequest,
    resolution_m: f64,
    n_pairs: usize,
) -> Result<Blended, RequestError> {
    if let Some(blended) = kept.blended.as_ref().filter(|_| !request.anew) {
        let of_map = blended.mapper.settings().resolution_m;
        if of_map != resolution_m {
            let text = format_args!(
                "is {resolution_m}, and what was seen so far is blended at {of_map} m: \
                 give that, or \"anew\": true to begin without it"
            );
            return Err(RequestError::at("out_of_range", &At::root("resolution_m"), text));
        }
        if blended.mapper.pairs().count() + n_pairs > PAIRS_MAX {
            let text = format_args!(
                "would make more than {PAIRS_MAX} pairs in one map: give \"anew\": true"
            );
            return Err(RequestError::at("too_many", &At::root("cameras"), text));
        }
        return Ok(blended.clone());
    }
    Blended::new(resolution_m)
}

impl Blended {
    /// Nothing was seen yet.
    fn new(resolution_m: f64) -> Result<Blended, RequestError> {
        let settings = MapSettings { resolution_m, ..MapSettings::default() };
        let at = At::root("resolution_m");
        let mapper = Mapper::new(settings).map_err(|error| terrain_error(&at, &error))?;
        Ok(Blended {
            mapper,
            has_prior: false,
            next_source: 0,
            names: BTreeMap::new(),
            shots: Shots::default(),
            captures: Vec::new(),
            found: BTreeMap::new(),
            keep_prior: true,
            from: None,
            stood: Vec::new(),
        })
    }
}

/// Blends what was received into the map, and puts it in use.
fn reconstruct(
    app: &AppState,
    who: &str,
    work: Work,
    (sources, failed): (Vec<PairSource>, Vec<FailedPair>),
    mut progress: Vec<PairProgress>,
    job: &JobHandle,
) -> Result<String, ApiError> {
    let mut blended = work.blended.clone();
    let latest = app.live.latest()?;
    let stood = contact::stood(&work.robot, &latest.frame);
    let step = SeenStep {
        id: job.id().to_owned(),
        prior: (work.keep_prior && !blended.has_prior).then(|| version_name(&work.ground)),
        keep_prior: work.keep_prior,
        resolution_m: work.resolution_m,
        region: work.region,
        relief_share: RasterizeOptions::default().relief_share,
        pair_shift_sigma_m: AlignSettings::default().pair_shift_sigma_m,
        wheels_m: stood.iter().map(|wheel| wheel.contact_m).collect(),
        solids: stood.iter().filter_map(|wheel| wheel.solid.clone()).collect(),
        time: latest.onboard_time,
        pairs: sources.iter().map(PairSource::recorded).collect(),
    };
    let on = |share: f64| request::IMAGES_SHARE + (0.95 - request::IMAGES_SHARE) * share;
    let mut tell = |i: usize, stage: PairStage| {
        let Some(of) = sources.get(i) else { return };
        let known = progress.iter_mut().find(|p| p.pair == of.pair && p.stage < stage);
        if let Some(known) = known {
            let fraction = if stage == PairStage::Received { 0.0 } else { 1.0 };
            (known.stage, known.fraction) = (stage, fraction);
        }
        let part = match stage {
            PairStage::Received => 0.0,
            PairStage::Matched => 0.8,
            _ => 1.0,
        };
        let doing = match stage {
            PairStage::Received => "matching",
            PairStage::Matched => "matched",
            _ => "is in the map",
        };
        let share = (i as f64 + part) / sources.len() as f64;
        job.progress_of(on(share), &format!("{}: {doing}", of.pair), &progress);
    };
    let site = blend::Site { robot: &work.robot, rig: &work.rig, ground: &work.ground };
    let made = blend::blend(&mut blended, &site, &step, &sources, job.stop(), &mut tell)?;
    let blend::Blend { before, pairs, pictures, sag } = made;
    let capture_time = sources.iter().map(PairSource::time).max().unwrap_or(latest.onboard_time);
    if pairs.iter().all(|pair| pair.cells == 0) {
        let message = "none of the pairs saw ground well enough: choose others, or a larger scale";
        return Err(ApiError::new("nothing_seen", message));
    }
    blended.note(&pairs, capture_time, job.id());
    job.progress(0.95, "judges the ground");
    let changes = blended.mapper.version().changes_since(&before);
    let names: Vec<&str> = pairs.iter().map(|pair| pair.name.as_str()).collect();
    let conflicts = contact::conflicts(blended.mapper.version(), &stood)?;
    let map = read(blended.mapper.version(), &work.ground, work.keep_prior, &names)?;
    let (since, what) = (app.store.current().info.version.clone(), names.join(", "));
    let told = versions::told(
        &since,
        VersionStep::Seen,
        format!("added {what}"),
        &changes,
        work.resolution_m,
    );
    let version = app.store.prepare_seen(map, app.clock.now(), blended.seen_by(Some(told)));
    job.stop().check()?;
    let area = |n: usize| n as f64 * work.resolution_m * work.resolution_m;
    let answer = ReconstructionAnswer {
        id: job.id().to_owned(),
        terrain_version: version.info.version.clone(),
        capture_time,
        resolution_m: work.resolution_m,
        scale: work.scale,
        seed: work.seed,
        keep_prior: work.keep_prior,
        pairs,
        failed,
        hip_turns_rad: sag,
        changed_cells: changes.cells,
        changed_m2: area(changes.cells),
        new_cells: changes.appeared,
        new_m2: area(changes.appeared),
        lost_cells: changes.vanished,
    };
    let mut text = format!(
        "new map: {}; {:.1} m² changed, {:.1} m² seen for the first time",
        version.info.source, answer.changed_m2, answer.new_m2
    );
    for (leg, turn) in &answer.hip_turns_rad {
        text += &format!("; {leg} hangs {:.1}° from where it is reported", turn.to_degrees());
    }
    let step = MapStep::Seen(step);
    let of = versions::InUse { n_grounds: work.n_grounds, version: None };
    versions::put(app, who, version, &of, &text, (Some(blended), step))?;
    for text in conflicts {
        app.live.notice(EventLevel::Caution, "server", &text);
    }
    let mut kept = app.reconstructions.locked();
    kept.answers.push_back(answer);
    while kept.answers.len() > ANSWERS_MAX {
        kept.answers.pop_front();
    }
    kept.pictures.keep(job.id(), pictures);
    drop(kept);
    Ok(format!("/api/v1/terrain/reconstructions/{}", job.id()))
}

/// Puts the map from before under what is seen.
fn add_prior(
    blended: &mut Blended,
    map: &ElevationMap,
    resolution_m: f64,
    time_ns: i64,
) -> Result<(), RequestError> {
    let at = At::root("keep_prior");
    let extent = map.grid().far_corner() - map.grid().origin;
    let n_nodes = extent.x / resolution_m * (extent.y / resolution_m);
    if n_nodes > PRIOR_NODES_MAX {
        let text = format_args!(
            "keeps a map of {n_nodes:.0} nodes of {resolution_m} m; at most {PRIOR_NODES_MAX:.0} are kept: \
             give a coarser resolution_m, or false"
        );
        return Err(RequestError::at("too_many", &at, text));
    }
    let refuse = |error| terrain_error(&at, &error);
    let dem = PairDem::of_map(map, resolution_m, PRIOR_SIGMA_M).map_err(refuse)?;
    let input = Input::Prior { source: blended.next_source, dem: Arc::new(dem), time_ns };
    blended.mapper.push(input).map_err(refuse)?;
    blended.next_source += 1;
    blended.has_prior = true;
    Ok(())
}

/// The blended map as a map for planners, as far as anything is known.
///
/// With the map from before, ground that the robot hides is what it was last known to be; without it, it is
/// unknown. Contradictions are unknown in any case.
fn read(
    version: &MapVersion,
    ground: &ElevationMap,
    keep: bool,
    names: &[&str],
) -> Result<ElevationMap, RequestError> {
    let policy = ReadPolicy { use_prior: keep, use_masked: keep, use_conflicts: false };
    let mut name = match names {
        [] => "what cameras saw was taken out".to_owned(),
        names => format!("seen by {}", names.join(", ")),
    };
    if keep {
        name += &format!(", else {}", source_text(ground));
    }
    let synthetic_detail = keep && ground.source().synthetic_detail;
    let source = Source { kind: SourceKind::File { name }, synthetic_detail };
    let refuse = |error| terrain_error(&At::root("cameras"), &error);
    // Trust is not asked for, so neither are times.
    let whole = version.elevation(policy, 0, 1.0, source.clone()).map_err(refuse)?.map;
    let (grid, heights) = (*whole.grid(), whole.heights());
    let mut ends = [usize::MAX, usize::MAX, 0, 0];
    for iy in 0..grid.ny {
        for ix in 0..grid.nx {
            if !heights.at(ix, iy).is_nan() {
                ends = [ends[0].min(ix), ends[1].min(iy), ends[2].max(ix), ends[3].max(iy)];
            }
        }
    }
    let [x0, y0, x1, y1] = ends;
    if x0 >= x1 || y0 >= y1 {
        return Err(RequestError::new("nothing_seen", "the map would have no known ground"));
    }
    let origin: Point2<f64> = grid.position(x0, y0);
    let known = Grid { origin, nx: x1 - x0 + 1, ny: y1 - y0 + 1, ..grid };
    let heights = Raster::from_fn(known, |ix, iy| *heights.at(x0 + ix, y0 + iy));
    Ok(ElevationMap::new(heights, source).with_placement(ground.placement().clone()))
}

/// An error of the work on a pair: that it was told to stop, or what does not fit.
fn stereo_error(stop: &Stop, pair: &str, error: &StereoError) -> ApiError {
    match stop.check() {
        Err(stopped) if *error == StereoError::Stopped => stopped.into(),
        _ => ApiError::new("out_of_range", format!("pair {pair}: {error}")),
    }
}
