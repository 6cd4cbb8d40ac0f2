//! Driving along an arc: planned as a track, sample by sample, and looked at before it is begun.
//!
//! The chassis keeps its tilt and goes along the arc in plan; its height follows the mean of its
//! wheels (active compliance with a level deck, F7). Each wheel keeps its place under the chassis in
//! plan and its gap to the ground: the legs follow the ground by inverse kinematics.

use collision::{Scene, wheel_ground};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rover::{Configuration, LegAngles, LegId, Posture, Robot, WheelPose};
use stability::support_polygon;

use crate::arc::Ramped;
use crate::command::DriveArc;
use crate::refusal::Refusal;
use crate::stand::{Foot, foot};
use crate::steer::{base_heading, heading_of, seated};
use crate::trace::Trace;

/// Speed of the fastest wheel, usual and most, for a robot of scale 1 (m/s). The field trials of
/// 2010 drove some 1 km/h on benign ground.
pub const DRIVE_SPEED: f64 = 0.1;
/// See [`DRIVE_SPEED`].
pub const DRIVE_SPEED_MAX: f64 = 0.28;
/// Longest way of one command, for a robot of scale 1 (m): what lies further is for the next look.
pub const DRIVE_DISTANCE_MAX: f64 = 20.0;
/// Steepest ground under a wheel (rad): 15°.
pub const DRIVE_SLOPE_MAX: f64 = 0.262;

/// Acceleration of the fastest wheel (m/s²), scale 1: as gentle as body shifts are.
const ACCELERATION: f64 = 0.05;
/// Distance of samples along the fastest wheel's way, scale 1 (m).
const SAMPLE: f64 = 0.02;
/// Least distance of a wheel from the arc's center, in wheel widths: nearer it turns on the spot.
const PIVOT_WIDTHS: f64 = 0.5;
/// Steepest way of a wheel's center. Before a step of height h a wheel of radius r goes up with the
/// slope √(2 r h - h²)/(r - h), which is √3 for a quarter of its diameter: more no tyre takes.
const STEP_SLOPE: f64 = 1.732;

/// A drive that can be begun.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Track {
    arc: DriveArc,
    /// The pose of the heading frame at the beginning.
    world_from_heading: Isometry3<f64>,
    /// The base in it at the beginning.
    heading_from_base: Isometry3<f64>,
    /// At even shares of the way: how much higher the base is, and the angles of all legs.
    knots: Vec<(f64, Vec<LegAngles>)>,
    /// By leg the spin at the beginning, and over the whole way (rad).
    spins: Vec<[f64; 2]>,
    ramped: Ramped,
}

impl Track {
    /// How long it takes (s).
    pub fn duration(&self) -> f64 {
        self.ramped.duration()
    }

    /// Share of the way after `t` (s).
    pub fn share_at(&self, t: f64) -> f64 {
        self.ramped.share_at(t)
    }

    /// Share of the way that is one look (a quarter of the radius of a wheel, some 6 cm).
    pub fn n_looks(&self) -> usize {
        self.knots.len().div_ceil(3)
    }

    /// Base and legs after a share of the way.
    pub fn at(&self, share: f64) -> Configuration {
        let place = share.clamp(0.0, 1.0) * (self.knots.len() - 1) as f64;
        let i = (place as usize).min(self.knots.len().saturating_sub(2));
        let (from, to) = (&self.knots[i], &self.knots[(i + 1).min(self.knots.len() - 1)]);
        let part = place - i as f64;
        let legs = from.1.iter().zip(&to.1).map(|(from, to)| from.lerp(to, part)).collect();
        let lift = from.0 + part * (to.0 - from.0);
        Configuration { world_from_base: self.base_at(share, lift), legs }
    }

    /// By leg the spin after a share of the way (rad). Over level ground it is even.
    pub fn spins_at(&self, share: f64) -> impl Iterator<Item = f64> {
        self.spins.iter().map(move |[from, by]| from + by * share)
    }

    /// By leg the spin per second after `t` (rad/s).
    pub fn spin_rates_at(&self, t: f64) -> impl Iterator<Item = f64> {
        let rate = self.ramped.speed_at(t) * self.ramped.length_inverse();
        self.spins.iter().map(move |[_, by]| by * rate)
    }

    fn base_at(&self, share: f64, lift: f64) -> Isometry3<f64> {
        let base = self.world_from_heading * self.arc.pose_at(share) * self.heading_from_base;
        Translation3::new(0.0, 0.0, lift) * base
    }
}

/// The heading frame of a base: its origin in plan, x where its x points in plan.
fn heading_frame(world_from_base: &Isometry3<f64>) -> Isometry3<f64> {
    let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), base_heading(world_from_base));
    let place = world_from_base.translation.vector;
    Isometry3::from_parts(Translation3::new(place.x, place.y, 0.0), turned)
}

/// Refuses an arc that no ground could make drivable; gives the way of the fastest wheel (m) and, by
/// leg, where each wheel is to head in `world` (rad).
pub(crate) fn headings(
    robot: &Robot,
    configuration: &Configuration,
    posture: &Posture,
    arc: &DriveArc,
) -> Result<(f64, Vec<(LegId, f64)>), Refusal> {
    check_arc(robot, arc)?;
    let frame = heading_frame(&configuration.world_from_base);
    let heading = base_heading(&configuration.world_from_base);
    let mut longest: f64 = 0.0;
    let mut wheels = Vec::with_capacity(robot.legs().len());
    for leg in robot.leg_ids() {
        let wheel = posture.wheel(robot, leg);
        let name = || robot.leg(leg).name.clone();
        if wheel.ball {
            return Err(Refusal::NoWheel { leg: name() });
        }
        let place = (frame.inverse() * wheel.center()).xy();
        if let Some(center) = arc.center() {
            let distance = (place - center).norm();
            let least = PIVOT_WIDTHS * wheel.width;
            if distance < least {
                return Err(Refusal::Pivot { leg: name(), distance, least });
            }
        }
        let way = arc.way_of(place);
        longest = longest.max(way.norm());
        wheels.push((leg, heading + way.y.atan2(way.x)));
    }
    Ok((longest, wheels))
}

fn check_arc(robot: &Robot, arc: &DriveArc) -> Result<(), Refusal> {
    let scale = robot.scale();
    let full = std::f64::consts::TAU;
    let most = DRIVE_DISTANCE_MAX * scale;
    range("the distance", arc.distance, [-most, most], "m")?;
    range("the turn", arc.turn, [-full, full], "rad")?;
    range("the course", arc.course, [-full, full], "rad")?;
    if let Some(speed) = arc.speed {
        range("the speed", speed, [1e-3 * scale, DRIVE_SPEED_MAX * scale], "m/s")?;
    }
    if arc.distance == 0.0 && arc.turn == 0.0 {
        return Err(Refusal::Nothing { what: "distance and no turn" });
    }
    Ok(())
}

/// Refuses a value that is not finite or out of its range.
pub(crate) fn range(
    what: &'static str,
    given: f64,
    [least, most]: [f64; 2],
    unit: &'static str,
) -> Result<(), Refusal> {
    if !given.is_finite() {
        return Err(Refusal::NotFinite { what: what.into() });
    }
    if (least..=most).contains(&given) {
        return Ok(());
    }
    Err(Refusal::Range { what, given, least, most, unit })
}

/// The track of an arc from where the wheels already head along it; `longest` is the way of the
/// fastest wheel (m), `spins` how far the wheels have spun before (rad).
pub(crate) fn track(
    scene: &Scene,
    configuration: &Configuration,
    arc: &DriveArc,
    longest: f64,
    spins: &[f64],
) -> Result<Track, Refusal> {
    let robot = scene.robot();
    let scale = robot.scale();
    let posture = Posture::new(robot, configuration);
    let frame = heading_frame(&configuration.world_from_base);
    let speed = arc.speed.unwrap_or(DRIVE_SPEED * scale);
    let n = (longest / (SAMPLE * scale)).ceil().max(1.0) as usize;
    let mut track = Track {
        arc: *arc,
        world_from_heading: frame,
        heading_from_base: frame.inverse() * configuration.world_from_base,
        knots: Vec::with_capacity(n + 1),
        spins: Vec::new(),
        ramped: Ramped::new(longest, speed, ACCELERATION * scale),
    };
    let way_of = |leg| arc.way_of((frame.inverse() * posture.wheel(robot, leg).center()).xy());
    let rolling = |leg: LegId| {
        let sample = way_of(leg).norm() / n as f64;
        Rolling::new(scene, configuration, &posture, leg, sample)
    };
    let mut wheels: Vec<Rolling<'_>> = robot.leg_ids().map(rolling).collect();
    for i in 0..=n {
        let share = i as f64 / n as f64;
        let moved = frame * arc.pose_at(share) * frame.inverse();
        let mut poses = Vec::with_capacity(wheels.len());
        for wheel in &mut wheels {
            poses.push(wheel.roll(scene, &moved, share * longest)?);
        }
        let lift = wheels.iter().map(|wheel| wheel.lift).sum::<f64>() / wheels.len() as f64;
        let base_from_world = track.base_at(share, lift).inverse();
        let mut legs = Vec::with_capacity(wheels.len());
        for (wheel, pose) in wheels.iter_mut().zip(&poses) {
            let followed = wheel.trace.follow(&(base_from_world * pose));
            legs.push(followed.map_err(|lost| Refusal::DriveReach {
                leg: robot.leg(wheel.leg).name.clone(),
                at: share * longest,
                why: lost.to_string(),
            })?);
        }
        if i == 0 {
            legs.clone_from(&configuration.legs);
        }
        track.knots.push((lift, legs));
        margin(scene, &track.at_knot(i, share), share * longest)?;
    }
    let heading = base_heading(&configuration.world_from_base);
    let spin = |wheel: &Rolling<'_>| {
        let heads = heading_of(&wheel.start).unwrap_or(0.0) - heading;
        let way = way_of(wheel.leg);
        let ahead = way.x * heads.cos() + way.y * heads.sin();
        wheel.way.copysign(ahead) / wheel.start.radius
    };
    track.spins = wheels.iter().zip(spins).map(|(wheel, from)| [*from, spin(wheel)]).collect();
    Ok(track)
}

impl Track {
    fn at_knot(&self, i: usize, share: f64) -> Configuration {
        let (lift, legs) = &self.knots[i];
        Configuration { world_from_base: self.base_at(share, *lift), legs: legs.clone() }
    }
}

/// Refuses a stance on the way that has not the margin of the rule.
fn margin(scene: &Scene, configuration: &Configuration, at: f64) -> Result<(), Refusal> {
    let robot = scene.robot();
    let posture = Posture::new(robot, configuration);
    let contacts: Vec<_> = robot.leg_ids().map(|leg| foot(scene, &posture, leg).point).collect();
    let com = posture.center_of_mass(robot);
    let margin = support_polygon::regular(&contacts)
        .map_or(f64::NEG_INFINITY, |support| support.depth_of(com.xy()));
    let least = robot.stance().margin;
    if margin < least { Err(Refusal::DriveMargin { at, margin, least }) } else { Ok(()) }
}

/// A wheel on its way.
struct Rolling<'a> {
    leg: LegId,
    start: WheelPose,
    /// Gap to the ground that it keeps (m).
    gap: Option<f64>,
    /// How much higher it is than at the beginning (m).
    lift: f64,
    /// Way of its center in plan, sample by sample (m).
    sample: f64,
    /// Way of its center so far, up and down included (m).
    way: f64,
    trace: Trace<'a>,
}

impl<'a> Rolling<'a> {
    fn new(
        scene: &'a Scene,
        configuration: &Configuration,
        posture: &Posture,
        leg: LegId,
        sample: f64,
    ) -> Rolling<'a> {
        let start = posture.wheel(scene.robot(), leg);
        let gap = wheel_ground(&start, scene.map(), |_| true).nearest.map(|gap| gap.gap);
        let trace = Trace::new(scene.robot(), leg, configuration.legs[leg.0]);
        Rolling { leg, start, gap, lift: 0.0, sample, way: 0.0, trace }
    }

    /// Its pose moved along in plan and seated, if the ground there is one to drive on.
    fn roll(
        &mut self,
        scene: &Scene,
        moved: &Isometry3<f64>,
        at: f64,
    ) -> Result<Isometry3<f64>, Refusal> {
        let mut wheel = self.start;
        wheel.world_from_wheel = moved * wheel.world_from_wheel;
        wheel.world_from_wheel.translation.vector.z += self.lift;
        let name = || scene.robot().leg(self.leg).name.clone();
        let under = wheel_ground(&wheel, scene.map(), |_| true);
        let patch = scene.map().footprint_plane(wheel.center().xy(), 2.0 * wheel.radius);
        let (Some(_), Some(patch), false) = (under.nearest, patch, under.unknown) else {
            return Err(Refusal::GroundUnknown { leg: name(), at });
        };
        let slope = patch.normal.z.clamp(-1.0, 1.0).acos();
        if slope > DRIVE_SLOPE_MAX {
            let most = DRIVE_SLOPE_MAX;
            return Err(Refusal::GroundSteep { leg: name(), at, slope, most });
        }
        let pose = seated(scene, wheel, self.gap);
        let rise = pose.translation.vector.z - wheel.world_from_wheel.translation.vector.z;
        // The first pose is where the wheel is.
        let way = if at > 0.0 { self.sample } else { 0.0 };
        if rise.abs() > STEP_SLOPE * way.max(1e-6) {
            return Err(Refusal::GroundStep { leg: name(), at, rise: rise.abs(), way });
        }
        self.lift += rise;
        self.way += way.hypot(rise);
        Ok(pose)
    }
}

/// Do all wheels stand? Else the one that does not.
pub(crate) fn all_stand(robot: &Robot, feet: &[Foot]) -> Result<(), Refusal> {
    match robot.leg_ids().find(|leg| !feet[leg.0].stands) {
        None => Ok(()),
        Some(leg) => Err(Refusal::WheelLifted { leg: robot.leg(leg).name.clone() }),
    }
}
