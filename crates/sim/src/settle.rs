//! Where and how the rover can be put down on a map.
//!
//! Around a wished place, outward on a spiral and in a few headings at each place, the rover is
//! stood on the ground: the base follows the plane through the ground under the wheels of the
//! named pose, each wheel is put down where that pose has it, and all is looked at: reach, limits,
//! collisions, margin rule. A first round takes only ground that is smooth under every wheel and
//! postures that keep all tolerances; a second round takes rough ground too, and a third whatever
//! stands without touching. The first that does is the answer, so the same wish gives the same one.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_6, TAU};

use collision::{NoTouchdown, Scene, Survey, Touch, Touchdown, survey, touchdowns};
use nalgebra::{Isometry3, Matrix3, Point2, Point3, Unit, UnitQuaternion, Vector3};
use rover::{Configuration, LegId, Posture, Robot};
use stability::{Preference, assess, verdict};

/// Headings tried at each place, from the wished one (rad): a hexapod looks the same after 60°.
const TURNS: [f64; 5] = [0.0, 0.5 * FRAC_PI_6, -0.5 * FRAC_PI_6, FRAC_PI_6, -FRAC_PI_6];
/// Heights of the base over the plane tried, from that of the pose, as shares of it.
const LIFTS: [f64; 4] = [0.0, 0.05, -0.05, 0.1];
/// Ways to put one wheel down that are tried.
const WAYS: usize = 6;
/// Changes of the way that a wheel is put down, over all wheels of one try.
const CHANGES: usize = 12;
/// A wheel whose gap to the ground is less touches it (m).
const TOUCHING: f64 = 1e-4;
/// Side of the patch of ground that must be smooth under a wheel, and the most that it may be
/// rough, in wheel radii.
const PATCH: f64 = 2.0;
const ROUGHNESS: f64 = 0.1;
/// Most places that a search may be asked for.
const PLACES_MAX: usize = 10_000;

/// How far to search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SettleOptions {
    /// Largest distance from the wished place (m).
    pub radius_m: f64,
    /// Places tried within it, 1 to 10 000; 1 tries the wished place alone.
    pub places: usize,
    /// Largest slope of the plane under the wheels, and so tilt of the base (rad).
    pub tilt_max_rad: f64,
}

impl Default for SettleOptions {
    /// 120 places within 5 m, tilted by up to 15°.
    fn default() -> SettleOptions {
        SettleOptions { radius_m: 5.0, places: 120, tilt_max_rad: 15.0_f64.to_radians() }
    }
}

/// A rover that stands.
#[derive(Debug, Clone, PartialEq)]
pub struct Settled {
    /// Base pose and joint angles.
    pub configuration: Configuration,
    /// Where each leg's wheel touches the ground, in `world` (m).
    pub contacts: Vec<Point3<f64>>,
    /// The regular margin (m).
    pub margin_m: f64,
    /// Horizontal distance from the wished place (m).
    pub moved_m: f64,
}

/// Why the rover does not stand at a place in a heading.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, thiserror::Error)]
pub enum Misfit {
    /// Part of the ground under the wheels is unknown or outside the map.
    #[error("the ground under the wheels is unknown or outside the map")]
    UnknownGround,
    /// The plane under the wheels is too steep.
    #[error("the ground under the wheels is too steep")]
    Slope,
    /// The ground under a wheel is too steep or too rough (first round only).
    #[error("the ground under a wheel is steep or rough")]
    Rough,
    /// A rock or a hole under a wheel.
    #[error("a wheel would stand on a rock or over a hole")]
    Uneven,
    /// A wheel is out of reach, or beyond its joints' limits.
    #[error("a leg does not reach the ground under it within its joint limits")]
    Reach,
    /// Links of the robot overlap, or are nearer than their tolerance (not in the last round).
    #[error("parts of the robot would touch each other")]
    SelfCollision,
    /// The robot is in the ground or an obstacle beside its wheels' contacts, or too near (not in
    /// the last round).
    #[error("the robot would touch ground or obstacles beside its contacts")]
    GroundCollision,
    /// The margin rule is not met.
    #[error("the stability margin would be too small")]
    Margin,
}

/// Why the rover was not put down.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SettleError {
    /// The robot has no pose of that name.
    #[error("there is no pose {pose:?}; the robot's poses are {known}")]
    UnknownPose {
        /// The name.
        pose: String,
        /// The names that there are.
        known: String,
    },
    /// A number out of its range.
    #[error("{field} is {value}; it must be {expected}")]
    Value {
        /// What it is.
        field: &'static str,
        /// Its value.
        value: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// It stands nowhere within reach of the search.
    #[error(
        "no place to stand within {radius_m} m of ({:.2}, {:.2}): {count} of {tries} tries fail because {reason}",
        wished.x, wished.y
    )]
    NoPlace {
        /// The wished place (m).
        wished: Point2<f64>,
        /// The search's radius (m).
        radius_m: f64,
        /// Places times headings that were tried.
        tries: usize,
        /// Why most of them fail.
        reason: Misfit,
        /// How many fail for that.
        count: usize,
        /// All reasons with their counts.
        reasons: Vec<(Misfit, usize)>,
    },
}

/// Stands the robot of the scene on its ground near `wished` (`world`, m) with its heading (rad,
/// counter-clockwise from x of `world`), legs as in the named pose of `robot.toml` as far as the
/// ground lets them.
pub fn settle(
    scene: &Scene,
    wished: Point2<f64>,
    heading_rad: f64,
    pose: &str,
    options: &SettleOptions,
) -> Result<Settled, SettleError> {
    check(wished, heading_rad, options)?;
    let robot = scene.robot();
    let nominal = robot.pose(pose).ok_or_else(|| SettleError::UnknownPose {
        pose: pose.chars().take(80).collect(),
        known: robot.poses().iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", "),
    })?;
    let mut reasons = BTreeMap::new();
    for care in [Care::Choosy, Care::Clear, Care::Plain] {
        let seat = Seat::new(scene, &nominal, options.tilt_max_rad, care);
        reasons = BTreeMap::new();
        for place in spiral(wished, options) {
            for turn in TURNS {
                match seat.at(place, heading_rad + turn) {
                    Ok(mut settled) => {
                        settled.moved_m = (place - wished).norm();
                        return Ok(settled);
                    }
                    Err(misfit) => *reasons.entry(misfit).or_insert(0) += 1,
                }
            }
        }
    }
    let mut reasons: Vec<(Misfit, usize)> = reasons.into_iter().collect();
    reasons.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let tries = reasons.iter().map(|(_, count)| count).sum();
    let (reason, count) = reasons[0];
    let radius_m = options.radius_m;
    Err(SettleError::NoPlace { wished, radius_m, tries, reason, count, reasons })
}

fn check(wished: Point2<f64>, heading: f64, options: &SettleOptions) -> Result<(), SettleError> {
    let finite = |field, value: f64| match value.is_finite() {
        true => Ok(()),
        false => Err(SettleError::Value { field, value, expected: "finite" }),
    };
    finite("the wished x", wished.x)?;
    finite("the wished y", wished.y)?;
    finite("the heading", heading)?;
    let within = |field, value: f64, lo: f64, hi: f64, expected| match (lo..=hi).contains(&value) {
        true => Ok(()),
        false => Err(SettleError::Value { field, value, expected }),
    };
    within("radius_m", options.radius_m, 0.0, 1e6, "0 to 1e6 m")?;
    within("places", options.places as f64, 1.0, PLACES_MAX as f64, "1 to 10 000")?;
    within("tilt_max_rad", options.tilt_max_rad, 0.0, 1.5, "0 to 1.5 rad")
}

/// The wished place first, then outward: Vogel's spiral, which covers the disc evenly.
fn spiral(wished: Point2<f64>, options: &SettleOptions) -> impl Iterator<Item = Point2<f64>> {
    let golden_angle = TAU * (1.0 - 0.5 * (5.0_f64.sqrt() - 1.0));
    let (radius, last) = (options.radius_m, options.places.saturating_sub(1).max(1) as f64);
    (0..options.places).map(move |k| {
        let (sin, cos) = (golden_angle * k as f64).sin_cos();
        wished + nalgebra::Vector2::new(cos, sin) * (radius * (k as f64 / last).sqrt())
    })
}

/// How much is asked of a place.
#[derive(Clone, Copy, PartialEq)]
enum Care {
    /// Smooth ground under every wheel, all tolerances kept.
    Choosy,
    /// All tolerances kept.
    Clear,
    /// It stands, reaches, does not touch, and meets the margin rule.
    Plain,
}

/// Seats the robot in one pose.
struct Seat<'a> {
    scene: &'a Scene,
    robot: &'a Robot,
    nominal: &'a Configuration,
    /// Where the wheels of the pose touch level ground, from the base (m).
    touches: Vec<Point3<f64>>,
    /// Height of the base over them (m).
    height: f64,
    tilt_max: f64,
    care: Care,
}

/// The plane z = a x + b y + d under the wheels.
struct Ground {
    normal: Unit<Vector3<f64>>,
    middle: Point3<f64>,
}

impl<'a> Seat<'a> {
    fn new(scene: &'a Scene, nominal: &'a Configuration, tilt_max: f64, care: Care) -> Seat<'a> {
        let robot = scene.robot();
        let posture = Posture::new(robot, nominal);
        let touch = |leg| posture.wheel(robot, leg).lowest_point(&Vector3::z_axis());
        let touches: Vec<Point3<f64>> = robot.leg_ids().map(touch).collect();
        let height = -touches.iter().map(|p| p.z).sum::<f64>() / touches.len() as f64;
        Seat { scene, robot, nominal, touches, height, tilt_max, care }
    }

    fn at(&self, place: Point2<f64>, heading: f64) -> Result<Settled, Misfit> {
        let ground = self.ground(place, heading)?;
        if ground.normal.z < self.tilt_max.cos() {
            return Err(Misfit::Slope);
        }
        let tilt = UnitQuaternion::rotation_between_axis(&Vector3::z_axis(), &ground.normal)
            .unwrap_or_default();
        let rotation = tilt * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading);
        let mut misfit = Misfit::Reach;
        for lift in LIFTS {
            let up = ground.normal.into_inner() * (self.height * (1.0 + lift));
            let base = Isometry3::from_parts((ground.middle.coords + up).into(), rotation);
            match self.stand(base, &ground.normal) {
                Ok(settled) => return Ok(settled),
                Err(why) => misfit = why,
            }
            // Another height changes nothing of what lies under the wheels.
            if matches!(misfit, Misfit::UnknownGround | Misfit::Rough | Misfit::Uneven) {
                break;
            }
        }
        Err(misfit)
    }

    /// The least-squares plane through the ground under the wheels of the pose on level ground.
    fn ground(&self, place: Point2<f64>, heading: f64) -> Result<Ground, Misfit> {
        let turn = nalgebra::Rotation2::new(heading);
        let (mut normal_matrix, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for touch in &self.touches {
            let offset = turn * touch.coords.xy();
            let z = self.scene.map().height_at(place + offset).ok_or(Misfit::UnknownGround)?;
            let row = Vector3::new(offset.x, offset.y, 1.0);
            normal_matrix += row * row.transpose();
            right += row * z;
        }
        let plane = normal_matrix.try_inverse().ok_or(Misfit::Slope)? * right;
        Ok(Ground {
            normal: Unit::new_normalize(Vector3::new(-plane.x, -plane.y, 1.0)),
            middle: Point3::new(place.x, place.y, plane.z),
        })
    }

    /// Puts all wheels down with the base there, and looks at what comes of it.
    fn stand(
        &self,
        world_from_base: Isometry3<f64>,
        normal: &Unit<Vector3<f64>>,
    ) -> Result<Settled, Misfit> {
        let mut configuration = Configuration { world_from_base, ..self.nominal.clone() };
        let hanging = Posture::new(self.robot, &configuration);
        let ways = self
            .robot
            .leg_ids()
            .map(|leg| self.ways(&hanging, leg, normal))
            .collect::<Result<Vec<_>, _>>()?;
        let mut chosen = vec![0; ways.len()];
        for _ in 0..CHANGES {
            let chosen_ways = ways.iter().zip(&chosen).map(|(ways, choice)| ways[*choice].angles);
            configuration.legs = chosen_ways.collect();
            let posture = Posture::new(self.robot, &configuration);
            let seen = survey(self.scene, &posture);
            let Some((misfit, legs)) = self.misfit(&seen) else {
                return self.weigh(configuration, &posture, &seen);
            };
            // One of the legs that touch is put down in another way, if there is one.
            let other = legs.iter().rev().find(|leg| chosen[leg.0] + 1 < ways[leg.0].len());
            let Some(leg) = other else { return Err(misfit) };
            chosen[leg.0] += 1;
        }
        Err(Misfit::SelfCollision)
    }

    /// Ways to put one wheel down under the place where the pose has it.
    fn ways(
        &self,
        hanging: &Posture,
        leg: LegId,
        normal: &Unit<Vector3<f64>>,
    ) -> Result<Vec<Touchdown>, Misfit> {
        let wheel = hanging.wheel(self.robot, leg);
        let p = wheel.lowest_point(normal).xy();
        if self.care == Care::Choosy && !self.is_smooth(p, wheel.radius) {
            return Err(Misfit::Rough);
        }
        touchdowns(self.scene, hanging, leg, p, &self.nominal.legs[leg.0], WAYS).map_err(|why| {
            match why {
                NoTouchdown::UnknownGround => Misfit::UnknownGround,
                NoTouchdown::Uneven { .. } => Misfit::Uneven,
                NoTouchdown::OutOfReach { .. } | NoTouchdown::JointLimits { .. } => Misfit::Reach,
            }
        })
    }

    fn is_smooth(&self, p: Point2<f64>, wheel_radius: f64) -> bool {
        let steepest = self.robot.stance().camber_limit.cos();
        self.scene.map().footprint_plane(p, PATCH * wheel_radius).is_some_and(|plane| {
            plane.normal.z >= steepest && plane.roughness <= ROUGHNESS * wheel_radius
        })
    }

    /// What is wrong with a posture, and the legs that have part in it.
    fn misfit(&self, seen: &Survey) -> Option<(Misfit, Vec<LegId>)> {
        let counts = |distance: f64| self.care != Care::Plain || distance <= 0.0;
        let of = |link| self.robot.body_of(link).map(|(leg, _)| leg);
        let links = seen.links.iter().find(|pair| counts(pair.distance));
        let environment = seen.environment.iter().find(|pair| counts(pair.distance));
        let pair = links.or(environment)?;
        Some(match pair.touch {
            Touch::Links(a, b) => {
                (Misfit::SelfCollision, [of(a), of(b)].into_iter().flatten().collect())
            }
            Touch::Ground(a) | Touch::Obstacle(a, _) | Touch::UnknownGround(a) => {
                (Misfit::GroundCollision, of(a).into_iter().collect())
            }
        })
    }

    /// The margin rule, and that all wheels touch.
    fn weigh(
        &self,
        configuration: Configuration,
        posture: &Posture,
        seen: &Survey,
    ) -> Result<Settled, Misfit> {
        let touches = |wheel: &collision::WheelGround| {
            !wheel.unknown && wheel.nearest.is_some_and(|gap| gap.gap.abs() <= TOUCHING)
        };
        if !seen.wheels.iter().all(touches) {
            return Err(Misfit::Uneven);
        }
        let standing = seen.contacts(self.scene, posture);
        // Gravity only scales forces; the margin rule does not look at them.
        let report = assess(self.robot, posture, &standing, 1.0);
        let rule = verdict(&report, self.robot.stance(), Preference::Regular);
        match (&report.regular, rule.ok) {
            (Ok(regular), true) => Ok(Settled {
                configuration,
                margin_m: regular.margin.depth_m,
                contacts: report.contacts,
                moved_m: 0.0,
            }),
            _ => Err(Misfit::Margin),
        }
    }
}
