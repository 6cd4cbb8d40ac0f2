//! Where a leg can be, seen from above, with its wheel over a place: a strip from the hip toward the wheel, and
//! a disc about it.
//!
//! Thigh and calf lie beside a plane that holds the axis of the hip's yaw and, but for the leg's offset, the
//! wrist; what hangs on the wrist is near to it. So ground that changed beside the strip and the disc is of no
//! matter to the place.

use std::f64::consts::PI;

use collision::{Footings, footfall_place};
use nalgebra::{Point2, Point3, Vector2, Vector3};
use rover::{LegChain, LinkId, Shape};

use crate::again::Area;
use crate::look::Look;

/// Tilt of the yaw axis beyond which nothing is said (rad).
const MOST_TILT: f64 = 0.35;

/// Of a leg with a closed form: lengths in m, seen from above.
pub(crate) struct Strip<'l, 'a> {
    look: &'l Look<'a>,
    hip: Point2<f64>,
    /// Direction of the leg's plane at hip yaw zero, and the limits of the yaw, counterclockwise (rad).
    ahead: f64,
    yaws: [f64; 2],
    /// What hip and knee carry.
    parts: Vec<Part>,
    /// How far the wrist is beside the plane.
    wrist_beside: f64,
    /// How far the wrist is from the wheel's center, across the ground's normal and along it.
    wrist: (f64, f64),
    /// How far from the wrist, and from the wheel's center, what hangs on them reaches.
    about_wrist: f64,
    about_wheel: f64,
}

/// A part of a leg: how far it gets from the hip toward the wheel and away from it, and beside the plane (m).
struct Part {
    reach: f64,
    behind: f64,
    beside: f64,
}

impl<'l, 'a> Strip<'l, 'a> {
    /// Of the leg that is looked at; none if it is of another build, or its yaw axis is not about upright.
    pub fn new(look: &'l Look<'a>) -> Option<Strip<'l, 'a>> {
        let (robot, leg) = (look.robot, look.robot.leg(look.leg));
        let ik = leg.ik.closed_form()?;
        let footings = Footings::new(look.scene, &look.posture, look.leg, look.options.heading);
        let frames = LegChain::new(robot, &look.posture, look.leg).frames(&look.angles);
        let (upright, across) = (frames.axes[0], frames.axes[1]);
        let tilt = upright.xy().norm();
        if tilt > MOST_TILT.sin() {
            return None;
        }
        let origin = |place: usize| Point3::from(frames.links[place].origin);
        let hip = look.hip;
        let wheel = look.posture.wheel(robot, look.leg);
        let wrist = wheel.world_from_wheel * ik.wheel_from_wrist();
        // The plane's direction away from the hip.
        let forward = across.cross(&upright).try_normalize(1e-9)?;
        let sense = upright.z.signum();
        let ahead = forward.y.atan2(forward.x) - sense * look.angles[0];
        let mut yaws = [leg.lower[0], leg.upper[0]].map(|yaw| sense * yaw);
        yaws.sort_by(f64::total_cmp);
        // A changed node changes all about it.
        let slack = robot.tolerances().environment + 2.0 * look.scene.map().grid().resolution;
        let mut parts = Vec::new();
        let (mut about_wrist, mut about_wheel) = (0.0_f64, look.about_seat());
        let mut lengths = [0.0; 3];
        for place in 1..3 {
            lengths[place] = lengths[place - 1] + (origin(place) - origin(place - 1)).norm();
        }
        let knee_behind = look.farthest_behind(&across, &forward, [origin(1), origin(2)]);
        for (i, link) in robot.links().iter().enumerate() {
            let Some((of, place)) = robot.body_of(LinkId(i)) else { continue };
            if of != look.leg {
                continue;
            }
            for shape in &link.shapes {
                let world_from_shape = look.posture.link(LinkId(i)) * shape.link_from_shape;
                let center = Point3::from(world_from_shape.translation.vector);
                let radius = shape.shape.bounding_radius() + slack;
                match place {
                    0..=2 => {
                        let from_link = (center - origin(place)).norm();
                        // What turns with the yaw alone is where it is; thigh and calf lie along the lines from the
                        // shoulder to the knee and from there to the wrist, which is ahead.
                        let back = match place {
                            0 => -(center - hip).dot(&forward),
                            1 => knee_behind + from_line(&center, origin(1), origin(2)),
                            _ => knee_behind + from_line(&center, origin(2), wrist),
                        };
                        let along = world_from_shape * Vector3::z();
                        let half_width = match &shape.shape {
                            Shape::Cylinder { radius, half_length }
                            | Shape::Capsule { radius, half_length } => {
                                half_length * along.dot(&across).abs() + radius + slack
                            }
                            _ => radius,
                        };
                        let reach = lengths[place] + from_link + radius;
                        // Along a tilted axis the plane leaves the line below it.
                        let off = tilt * reach;
                        parts.push(Part {
                            reach: reach + off,
                            behind: back + radius + off,
                            beside: (center - hip).dot(&across).abs() + half_width + off,
                        });
                    }
                    5 => about_wheel = about_wheel.max((center - wheel.center()).norm() + radius),
                    _ => about_wrist = about_wrist.max((center - wrist).norm() + radius),
                }
            }
        }
        Some(Strip {
            look,
            hip: hip.xy(),
            ahead,
            yaws,
            parts,
            wrist_beside: (wrist - hip).dot(&across).abs() + tilt * look.reach,
            wrist: footings.farthest_wrist()?,
            about_wrist,
            about_wheel,
        })
    }

    /// May a part of the leg be over the area, or the wheel by it, with the wheel at `p`? The ground about `p` must
    /// be what it was unless the area is near.
    pub fn may_meet(&self, area: &Area, p: Point2<f64>) -> bool {
        let distance = area.distance(&p);
        let wheel = &self.look.robot.leg(self.look.leg).wheel;
        if distance <= self.about_wheel + wheel.radius {
            return true;
        }
        // Where there is no place for a wheel, the leg does not matter.
        let Some(place) = footfall_place(self.look.scene, self.look.leg, p) else { return false };
        let slope = place.normal.xy().norm();
        // From the place to the wheel's center, and on to the wrist.
        let to_wrist = self.wrist.0 + slope * (wheel.radius + self.wrist.1);
        if distance <= to_wrist + self.about_wrist {
            return true;
        }
        let (middle, size) = (nalgebra::center(&area.min, &area.max), area.max - area.min);
        let (to_area, to_place) = (middle - self.hip, p - self.hip);
        let off = seen_under(self.wrist_beside + to_wrist, &to_place);
        let between = angle_of(&to_area) - angle_of(&to_place);
        // The wrist is on the leg's side of the yaw axis, or beyond it.
        let over = wrapped(angle_of(&to_place) + PI - self.ahead);
        let turns_back = [over, over - 2.0 * PI, over + 2.0 * PI]
            .iter()
            .any(|yaw| *yaw >= self.yaws[0] - off - 1e-9 && *yaw <= self.yaws[1] + off + 1e-9);
        self.parts.iter().any(|part| {
            let open = off + seen_under(0.5 * size.norm() + part.beside, &to_area);
            let meets = |turned: f64, reach: f64| {
                let far = to_area.norm() - 0.5 * size.norm();
                far <= reach && wrapped(between - turned).abs() <= open + 1e-9
            };
            let behind = if turns_back { part.reach } else { part.behind };
            meets(0.0, part.reach) || meets(PI, behind)
        })
    }
}

impl Look<'_> {
    /// How far behind the yaw axis shoulder and knee can get, at any hip pitch (m); zero if they are always ahead.
    fn farthest_behind(
        &self,
        across: &Vector3<f64>,
        forward: &Vector3<f64>,
        [shoulder, knee]: [Point3<f64>; 2],
    ) -> f64 {
        let leg = self.robot.leg(self.leg);
        let thigh = knee - shoulder;
        let (x, w) = (thigh.dot(forward), thigh.dot(&forward.cross(across)));
        let now = w.atan2(x);
        let range = [leg.lower[1] - self.angles[1], leg.upper[1] - self.angles[1]];
        // Whichever way the joint counts.
        let least = [range, [-range[1], -range[0]]].map(|[from, to]| {
            let (from, to) = (now + from, now + to);
            let back = ((from - PI) / (2.0 * PI)).ceil() * 2.0 * PI + PI;
            if back <= to { -1.0 } else { from.cos().min(to.cos()) }
        });
        let ahead = (shoulder - self.hip).dot(forward);
        let knee_ahead = ahead + x.hypot(w) * least[0].min(least[1]);
        -knee_ahead.min(ahead).min(0.0)
    }
}

/// Distance of a point from the line between two others (m).
fn from_line(point: &Point3<f64>, a: Point3<f64>, b: Point3<f64>) -> f64 {
    let way = b - a;
    let share = (point - a).dot(&way) / way.norm_squared();
    let share = if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) };
    (point - (a + way * share)).norm()
}

fn angle_of(v: &Vector2<f64>) -> f64 {
    v.y.atan2(v.x)
}

/// Half the angle under which a disc of this radius (m) is seen from a distance; all around from within.
fn seen_under(radius: f64, to: &Vector2<f64>) -> f64 {
    let distance = to.norm();
    if radius < distance { (radius / distance).clamp(0.0, 1.0).asin() } else { PI }
}

fn wrapped(angle: f64) -> f64 {
    angle - (angle / (2.0 * PI)).round() * 2.0 * PI
}
