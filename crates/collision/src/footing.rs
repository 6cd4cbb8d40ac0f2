//! One place of ground looked at for one wheel: the orientations in which it may be put down there.
//!
//! Each orientation is turned down by the quickest question first: whether the wrist would be out of
//! reach, then how the wheel sits on the ground, then whether there are joint angles. The wheel is the
//! same solid whatever the pitch of its fork, so it is seated once a yaw.

use std::f64::consts::PI;

use arrayvec::ArrayVec;
use nalgebra::{Matrix3, Point2, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use rover::{
    Branch, Frame, IkSolution, Leg, LegAngles, LegId, LinkId, MAX_SOLUTIONS, NoSolution, Posture,
    WheelPose,
};

use crate::scene::Scene;
use crate::touchdown::{FootfallPlace, Touchdown, footfall_place};
use crate::wheel::{
    contact_center, contact_center_on, patch_normal, wheel_ground, wheel_ground_near,
};

/// Yaws tried about the ground's normal (rad), from the one that keeps the knee roll small.
const YAWS: [f64; 7] = [0.0, 0.524, -0.524, 1.047, -1.047, 1.571, -1.571];
/// The axle along a given line, either way.
const FIXED_YAWS: [f64; 2] = [0.0, PI];
/// Pitches of the fork tried about the axle (rad), 0 being along the normal.
const FORK_PITCHES: [f64; 5] = [0.0, 0.262, -0.262, 0.524, -0.524];
/// Most orientations that are tried.
const MOST_ORIENTATIONS: usize = YAWS.len() * FORK_PITCHES.len();
/// Most that seating may shift a wheel, as a share of its radius: beyond, the ground under it is
/// no place for a wheel.
const SEATING_SHIFT: f64 = 0.5;

/// Which way a wheel may roll where it is put down.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum WheelHeading {
    /// Any: yaw about the contact's normal is free (F47).
    #[default]
    Free,
    /// Along this direction, seen from above and counted from x of `world` (rad) (F44), or against
    /// it, which is the same for a wheel.
    Fixed(f64),
}

/// A leg whose base stands, prepared for looking at many places.
pub struct Footings<'a> {
    scene: &'a Scene,
    posture: &'a Posture,
    leg: LegId,
    model: &'a Leg,
    base_from_world: Frame,
    heading: WheelHeading,
    /// Sine and cosine of the yaws and of the fork's pitches that are tried.
    yaws: ArrayVec<(f64, f64), { YAWS.len() }>,
    fork_pitches: ArrayVec<(f64, f64), { FORK_PITCHES.len() }>,
    /// By orientation, [where the wrist is](Self::wrist).
    wrists: ArrayVec<Vector3<f64>, MOST_ORIENTATIONS>,
    /// The same by coordinate.
    wrists_by_coordinate: [[f64; MOST_ORIENTATIONS]; 3],
}

/// Where a wheel sits on the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seat {
    /// How far it was shifted upward for that (m).
    pub shift: f64,
    /// Where it touches, in `world` (m).
    pub contact: Point3<f64>,
}

/// Why a wheel does not sit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NoSeat {
    /// The ground below it is unknown.
    Unknown,
    /// It would have to be shifted by this much (m), which is too far.
    Uneven(f64),
}

impl<'a> Footings<'a> {
    /// Prepares `leg` with the base as in `posture`.
    pub fn new(
        scene: &'a Scene,
        posture: &'a Posture,
        leg: LegId,
        heading: WheelHeading,
    ) -> Footings<'a> {
        let model = scene.robot().leg(leg);
        // Where the leg cannot choose the orientation, one stands for all.
        let (yaws, fork_pitches) = match heading {
            _ if !model.ik.fixes_orientation() => (&YAWS[..1], &FORK_PITCHES[..1]),
            WheelHeading::Free => (&YAWS[..], &FORK_PITCHES[..]),
            WheelHeading::Fixed(_) => (&FIXED_YAWS[..], &FORK_PITCHES[..]),
        };
        let table = |angles: &[f64]| angles.iter().map(|angle| angle.sin_cos()).collect();
        let (yaws, fork_pitches) =
            (table(yaws), fork_pitches.iter().map(|a| a.sin_cos()).collect());
        let base_from_world = Frame::from(&posture.link(LinkId(0)).inverse());
        let mut footings = Footings {
            scene,
            posture,
            leg,
            model,
            base_from_world,
            heading,
            yaws,
            fork_pitches,
            wrists: ArrayVec::new(),
            wrists_by_coordinate: [[0.0; MOST_ORIENTATIONS]; 3],
        };
        footings.wrists = (0..footings.n_orientations()).map(|o| footings.wrist(o)).collect();
        for (i, of_all) in footings.wrists_by_coordinate.iter_mut().enumerate() {
            of_all.iter_mut().zip(&footings.wrists).for_each(|(of, wrist)| *of = wrist[i]);
        }
        footings
    }

    /// The wrist from the wheel's center in an orientation, along the axle at yaw zero, across and along
    /// the normal (m): that of the point that [`Footing::frame`] has there.
    fn wrist(&self, orientation: usize) -> Vector3<f64> {
        let Some(ik) = self.model.ik.closed_form() else { return Vector3::zeros() };
        let n_pitches = self.fork_pitches.len();
        let ((sin, cos), (sin_pitch, cos_pitch)) =
            (self.yaws[orientation / n_pitches], self.fork_pitches[orientation % n_pitches]);
        let wrist = ik.wheel_from_wrist();
        let aside = wrist.z * cos_pitch - wrist.x * sin_pitch;
        let down = cos_pitch * wrist.x + sin_pitch * wrist.z;
        Vector3::new(cos * wrist.y + sin * aside, sin * wrist.y - cos * aside, -down)
    }

    /// How far the wrist is at most from the wheel's center, across the ground's normal and along it, in the
    /// orientations that are tried (m); none for a leg without closed form.
    pub fn farthest_wrist(&self) -> Option<(f64, f64)> {
        self.model.ik.closed_form()?;
        let most = |of: fn(&Vector3<f64>) -> f64| self.wrists.iter().map(of).fold(0.0, f64::max);
        Some((most(|wrist| wrist.xy().norm()), most(|wrist| wrist.z.abs())))
    }

    /// Number of orientations that are tried in a place.
    pub fn n_orientations(&self) -> usize {
        self.yaws.len() * self.fork_pitches.len()
    }

    /// Number of an orientation's yaw: those that share it are of the same solid wheel.
    pub fn yaw_of(&self, orientation: usize) -> usize {
        orientation / self.fork_pitches.len()
    }

    /// The place at `p`; none where its ground is unknown, or so steep that a wheel has no axle
    /// across.
    pub fn at(&self, p: Point2<f64>) -> Option<Footing<'_>> {
        let place = footfall_place(self.scene, self.leg, p)?;
        let hip = self.posture.link(self.model.links[0]).translation.vector;
        let heading = match self.heading {
            WheelHeading::Free => {
                let across = Vector3::z().cross(&Vector3::new(p.x - hip.x, p.y - hip.y, 0.0));
                if across.norm() > 1e-6 { across } else { Vector3::y() }
            }
            WheelHeading::Fixed(yaw) => Vector3::new(-yaw.sin(), yaw.cos(), 0.0),
        };
        let normal = place.normal.into_inner();
        let axle = (heading - normal * normal.dot(&heading)).try_normalize(1e-9)?;
        let across = normal.cross(&axle);
        let seats = ArrayVec::new_const();
        let base = &self.base_from_world;
        let center = place.ground.coords + normal * self.model.wheel.radius;
        let turned = [axle, across, normal].map(|v| base.rotation * v);
        let center = base.point(&center.into());
        let from_hip = self.model.ik.closed_form().map(|ik| {
            let [axle, across, normal] = turned.map(|v| ik.along_plane(&v));
            [axle, across, normal, ik.from_hip(&center)]
        });
        // On level ground the patch below the wheel's center is that of the place itself.
        let below = place.ground.coords + normal * self.model.wheel.radius;
        let patch = (below.xy() == p.coords).then_some(Some(place.normal));
        Some(Footing { of: self, place, axle, across, from_hip, seats, patch, nearest: None })
    }
}

/// One place.
pub struct Footing<'a> {
    of: &'a Footings<'a>,
    /// The ground there.
    pub place: FootfallPlace,
    /// The axle at yaw zero, and the direction that it turns to.
    axle: Vector3<f64>,
    across: Vector3<f64>,
    /// Axle, across, the normal and the center of a wheel before it is seated, as seen from the hip of a
    /// leg with a closed form.
    from_hip: Option<[Vector3<f64>; 4]>,
    /// By yaw, those that have been asked for.
    seats: ArrayVec<(usize, Result<Seat, NoSeat>), { YAWS.len() }>,
    /// The normal of the patch below the wheel's center, which is the same for all yaws, once it has been
    /// asked for.
    patch: Option<Option<Unit<Vector3<f64>>>>,
    /// The point of ground that a wheel seated here, or next to here, was nearest to: a good place to
    /// look at first.
    pub nearest: Option<Point2<f64>>,
}

impl Footing<'_> {
    /// The wheel in an orientation, before it is seated: its rotation, fork, axle and what is across
    /// both, and its center one radius above the ground.
    fn frame(&self, orientation: usize) -> Frame {
        let n_pitches = self.of.fork_pitches.len();
        let (yaw, pitch) =
            (self.of.yaws[orientation / n_pitches], self.of.fork_pitches[orientation % n_pitches]);
        let normal = self.place.normal.into_inner();
        let axle = turned(&self.axle, &self.across, yaw);
        let fork = turned(&-normal, &normal.cross(&axle), pitch);
        Frame {
            rotation: Matrix3::from_columns(&[fork, axle, fork.cross(&axle)]),
            origin: self.place.ground.coords + normal * self.of.model.wheel.radius,
        }
    }

    /// How far the wrist is out of reach in an orientation before the wheel is seated (m); zero where
    /// it is not known to be.
    pub fn missed(&self, orientation: usize) -> f64 {
        let Some(ik) = self.of.model.ik.closed_form() else { return 0.0 };
        let Some([axle, across, normal, center]) = &self.from_hip else { return 0.0 };
        let wrist = &self.of.wrists[orientation];
        let from_center = axle * wrist.x + across * wrist.y + normal * wrist.z;
        ik.missed_from_hip(&(center + from_center))
    }

    /// As [`missed`](Self::missed) in each orientation.
    pub fn misses(&self) -> ArrayVec<f64, MOST_ORIENTATIONS> {
        let mut misses = ArrayVec::new();
        match (self.of.model.ik.closed_form(), &self.from_hip) {
            (Some(ik), Some([axle, across, normal, center])) => {
                // By coordinate, so that several are found at once.
                let mut places = [[0.0; MOST_ORIENTATIONS]; 3];
                for (i, place) in places.iter_mut().enumerate() {
                    let (axle, across, normal, center) = (axle[i], across[i], normal[i], center[i]);
                    let [x, y, z] = &self.of.wrists_by_coordinate;
                    for (((place, x), y), z) in place.iter_mut().zip(x).zip(y).zip(z) {
                        *place = center + (axle * x + across * y + normal * z);
                    }
                }
                let mut all = [0.0; MOST_ORIENTATIONS];
                ik.misses_from_hip(&places, &mut all);
                misses.extend(all);
                misses.truncate(self.of.n_orientations());
            }
            _ => misses.extend((0..self.of.n_orientations()).map(|_| 0.0)),
        }
        misses
    }

    /// How the wheel sits in an orientation: shifted along z until it just touches.
    pub fn seat(&mut self, orientation: usize) -> Result<Seat, NoSeat> {
        let yaw = self.of.yaw_of(orientation);
        if let Some((_, seat)) = self.seats.iter().find(|(of, _)| *of == yaw) {
            return *seat;
        }
        let seat = self.seated(&self.wheel(&self.frame(orientation)));
        // There is a place for each yaw.
        self.seats.push((yaw, seat));
        seat
    }

    fn seated(&mut self, wheel: &WheelPose) -> Result<Seat, NoSeat> {
        let map = self.of.scene.map();
        let below = wheel_ground_near(wheel, map, self.nearest, |_| true);
        let gap = below.nearest.filter(|_| !below.unknown).ok_or(NoSeat::Unknown)?;
        self.nearest = Some(gap.ground.xy());
        if gap.gap.abs() > SEATING_SHIFT * wheel.radius {
            return Err(NoSeat::Uneven(gap.gap.abs()));
        }
        let lift = Translation3::new(0.0, 0.0, -gap.gap);
        let seated = WheelPose { world_from_wheel: lift * wheel.world_from_wheel, ..*wheel };
        let patch = *self.patch.get_or_insert_with(|| patch_normal(&seated, map));
        Ok(Seat { shift: -gap.gap, contact: contact_center_on(&seated, map, &gap, patch) })
    }

    fn wheel(&self, frame: &Frame) -> WheelPose {
        let wheel = &self.of.model.wheel;
        let rotation = nalgebra::Rotation3::from_matrix_unchecked(frame.rotation);
        WheelPose {
            world_from_wheel: nalgebra::Isometry3::from_parts(
                frame.origin.into(),
                UnitQuaternion::from_rotation_matrix(&rotation),
            ),
            radius: wheel.radius,
            width: wheel.width,
            ball: wheel.ball,
        }
    }

    /// The wheel in an orientation before it is seated, its center one radius above the ground.
    pub fn unseated_wheel(&self, orientation: usize) -> WheelPose {
        self.wheel(&self.frame(orientation))
    }

    /// The seated wheel in an orientation.
    pub fn seated_wheel(&self, orientation: usize, seat: &Seat) -> WheelPose {
        self.wheel(&self.seated_frame(orientation, seat, 0.0))
    }

    /// Number of an orientation's yaw: those that share it are of the same solid wheel.
    pub fn yaw_of(&self, orientation: usize) -> usize {
        self.of.yaw_of(orientation)
    }

    /// Number of orientations.
    pub(crate) fn n_orientations(&self) -> usize {
        self.of.n_orientations()
    }

    /// The wheel in an orientation before it is seated, in `world`.
    pub(crate) fn unseated(&self, orientation: usize) -> Frame {
        self.frame(orientation)
    }

    /// The wheel `lift` (m) above its seat, in `world`.
    pub fn seated_frame(&self, orientation: usize, seat: &Seat, lift: f64) -> Frame {
        let mut frame = self.frame(orientation);
        frame.origin.z += seat.shift + lift;
        frame
    }

    /// Joint angles within the limits that hold the wheel in an orientation, `lift` (m) above its
    /// seat.
    pub fn angles(
        &self,
        orientation: usize,
        seat: &Seat,
        lift: f64,
    ) -> Result<ArrayVec<LegAngles, MAX_SOLUTIONS>, NoSolution> {
        let frame = self.seated_frame(orientation, seat, lift);
        let model = self.of.model;
        let solutions = model.ik.solve_within(model, &self.of.base_from_world.after(&frame))?;
        Ok(solutions.into_iter().map(|s| s.angles).collect())
    }

    /// Of the [`angles`](Self::angles) those nearest to others, by the joint that differs most; sooner if they
    /// are of a `branch` that is given.
    pub fn nearest_angles(
        &self,
        orientation: usize,
        seat: &Seat,
        lift: f64,
        to: &LegAngles,
        branch: Option<Branch>,
    ) -> Option<IkSolution> {
        let frame = self.seated_frame(orientation, seat, lift);
        let model = self.of.model;
        model.ik.solve_nearest(model, &self.of.base_from_world.after(&frame), to, branch)
    }

    /// The wheel put down with these joint angles, which came from [`angles`](Self::angles); none if
    /// the orientation that the leg gives the wheel is none to stand in.
    pub fn touchdown(
        &self,
        orientation: usize,
        seat: &Seat,
        angles: LegAngles,
    ) -> Option<Touchdown> {
        let place = self.place;
        if self.of.model.ik.fixes_orientation() {
            let wheel = self.seated_wheel(orientation, seat);
            return Some(Touchdown { place, wheel, contact: seat.contact, angles });
        }
        let robot = self.of.scene.robot();
        let wheel = self.of.posture.with_leg(robot, self.of.leg, &angles).wheel(robot, self.of.leg);
        let contact = self.stands(&wheel)?;
        Some(Touchdown { place, wheel, contact, angles })
    }

    /// Where a wheel touches whose orientation the leg's joints gave it: none if it does not stand
    /// there by the robot's rules. A ball stands wherever it was put.
    fn stands(&self, wheel: &WheelPose) -> Option<Point3<f64>> {
        let map = self.of.scene.map();
        let below = wheel_ground(wheel, map, |_| true);
        let gap = below.nearest.filter(|_| !below.unknown)?;
        let rules = self.of.scene.robot().stance();
        let level = wheel.camber(&self.place.normal) <= rules.camber_limit;
        (level && gap.gap.abs() <= rules.ground_tolerance).then(|| contact_center(wheel, map, &gap))
    }
}

/// `from` turned by an angle, of which sine and cosine are given, toward `to`, which is perpendicular to it.
fn turned(from: &Vector3<f64>, to: &Vector3<f64>, (sin, cos): (f64, f64)) -> Vector3<f64> {
    from * cos + to * sin
}
