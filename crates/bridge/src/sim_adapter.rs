//! The simulated rover behind the link, in process.

mod imaging;
mod motion;
mod telemetry;

use sim::{Basis, Cameras, Command, Event, SimRover, Stage};
use wire::live::{AckStage, CommandBody, Downlink, Executing, Uplink};
use wire::time::Timestamp;

use crate::adapter::RoverAdapter;

pub use motion::of_body as motion_of;

/// Time between telemetry frames (s).
pub const FRAME_PERIOD_S: f64 = 0.1;

/// After a pause of the whole process longer than this (s) only the frames of its end are sent.
const CATCH_UP_S: f64 = 30.0;

/// Drives a [`SimRover`] by the time that is handed in, and speaks for it.
pub struct SimAdapter {
    rover: SimRover,
    /// Ground time at which time on board was zero.
    start: Timestamp,
    /// Frames due so far; counted, for a sum of tenths drifts.
    n_frames: u64,
    said: Vec<(Timestamp, Downlink)>,
    cameras: Option<Cameras>,
}

impl SimAdapter {
    /// The rover as it is, its time on board beginning to run at `now`.
    pub fn new(now: Timestamp, rover: SimRover) -> SimAdapter {
        let start = now.plus_seconds(-rover.time_s());
        let n_frames = (rover.time_s() / FRAME_PERIOD_S).ceil() as u64;
        SimAdapter { rover, start, n_frames, said: Vec::new(), cameras: None }
    }

    /// The rover makes itself safe when it moves and nothing comes up for so long (s); never where
    /// absent.
    pub fn with_silence_max(mut self, silence_max_s: Option<f64>) -> SimAdapter {
        self.rover.set_silence_max(silence_max_s);
        self.rover.heard_ground();
        self
    }

    /// With cameras; without, it refuses to take images.
    pub fn with_cameras(mut self, cameras: Cameras) -> SimAdapter {
        self.cameras = Some(cameras);
        self
    }

    /// Time on board of the next frame (s).
    fn next_frame_s(&self) -> f64 {
        self.n_frames as f64 * FRAME_PERIOD_S
    }

    fn go_to(&mut self, now: Timestamp) {
        let now_s = now.seconds_since(self.start);
        if now_s - self.next_frame_s() > CATCH_UP_S {
            self.n_frames = ((now_s - CATCH_UP_S) / FRAME_PERIOD_S) as u64;
        }
        // Times come as whole nanoseconds: a frame due at this very instant is due.
        while self.next_frame_s() <= now_s + 1e-9 {
            let due_s = self.next_frame_s();
            self.run_until(due_s);
            self.said.push((self.time(due_s), self.telemetry()));
            self.n_frames += 1;
        }
        self.run_until(now_s);
    }

    fn run_until(&mut self, time_s: f64) {
        self.rover.advance(time_s - self.rover.time_s());
        self.hear();
        self.hear_cameras();
    }

    /// Takes over what the rover says of its commands.
    fn hear(&mut self) {
        for event in self.rover.take_events() {
            self.say(event);
        }
    }

    fn say(&mut self, event: Event) {
        let stage = match event.stage {
            Stage::Received => AckStage::Received,
            Stage::Rejected => AckStage::Rejected,
            Stage::Started => AckStage::Started,
            Stage::Completed => AckStage::Completed,
            Stage::Failed => AckStage::Failed,
            Stage::Aborted => AckStage::Aborted,
        };
        let ack = Downlink::Ack { id: event.id, stage, detail: event.detail };
        self.said.push((self.time(event.time_s), ack));
    }

    fn time(&self, time_s: f64) -> Timestamp {
        self.start.plus_seconds(time_s)
    }

    fn telemetry(&self) -> Downlink {
        let robot = self.rover.scene().robot();
        let mut telemetry = telemetry::of_frame(robot, self.rover.frame());
        // A motion, else what the cameras are at.
        telemetry.executing = telemetry.executing.or_else(|| {
            let (id, progress) = self.cameras.as_ref()?.under_way()?;
            Some(Executing { command_id: id.to_owned(), progress, step: None })
        });
        Downlink::Telemetry(telemetry)
    }

    fn refuse(&mut self, id: String, detail: String) {
        let now = self.time(self.rover.time_s());
        let (stage, detail) = (AckStage::Rejected, Some(detail));
        self.said.push((now, Downlink::Ack { id, stage, detail }));
    }
}

impl RoverAdapter for SimAdapter {
    fn uplink(&mut self, now: Timestamp, message: Uplink) {
        self.go_to(now);
        self.rover.heard_ground();
        match message {
            Uplink::Estop { id } => self.rover.estop(&id),
            Uplink::EstopRelease { id } => self.rover.release(&id),
            Uplink::Heartbeat {} => {}
            Uplink::Image(ask) => self.ask_cameras(ask),
            Uplink::Command {
                id,
                body,
                basis_joints_rad,
                basis_tolerance_rad,
                model_hash,
                epoch,
                preconditions,
            } => {
                let robot = self.rover.scene().robot().clone();
                let own = format!("{:016x}", robot.hash());
                if let Some(other) = model_hash.filter(|hash| *hash != own) {
                    let other: String = other.chars().take(64).collect();
                    let why = format!(
                        "the command was checked with the robot model {other}, but the rover is \
                         {own}: plan again"
                    );
                    self.refuse(id, why);
                    return;
                }
                if let CommandBody::Image(order) = &body {
                    let gate = motion::gate(&robot, &preconditions, self.start);
                    self.take_images(id, epoch, gate.as_ref(), order);
                    self.hear();
                    return;
                }
                let legs = motion::angles_by_leg(&robot, &basis_joints_rad)
                    .map_err(|why| format!("basis: {why}"));
                let motion = motion::of_body(&robot, &body, self.start);
                let motion = motion
                    .and_then(|motion| motion::waiting(&robot, motion, &preconditions, self.start));
                match motion.and_then(|motion| Ok((motion, legs?))) {
                    Ok((motion, legs)) => {
                        let basis = Basis { legs, tolerance: basis_tolerance_rad };
                        let basis = (!basis.legs.is_empty()).then_some(basis);
                        self.rover.command(Command { id, motion, basis, epoch });
                    }
                    Err(why) => self.refuse(id, why),
                }
            }
        }
        self.hear();
    }

    fn advance(&mut self, now: Timestamp) -> Vec<(Timestamp, Downlink)> {
        self.go_to(now);
        std::mem::take(&mut self.said)
    }
}
