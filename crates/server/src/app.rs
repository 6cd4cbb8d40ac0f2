//! Everything that the routes share.

use std::sync::Arc;

use bridge::clock::Clock;
use bridge::recorder::ChannelSchema;
use tokio::sync::{Semaphore, watch};

use crate::config::Config;
use crate::drape::Overlays;
use crate::error::ApiError;
use crate::gate::Gate;
use crate::jobs::Jobs;
use crate::live::Live;
use crate::live_reach::LiveReach;
use crate::plans::{Plans, Postures};
use crate::reconstruction::Reconstructions;
use crate::replays::Replays;
use crate::robots::Robots;
use crate::scene::Context;
use crate::terrain_store::TerrainStore;
use crate::terrains::Terrains;

/// What routes are given.
pub type AppState = Arc<App>;

/// The ground server, all parts together.
pub struct App {
    /// Settings.
    pub config: Arc<Config>,
    /// The time.
    pub clock: Arc<dyn Clock>,
    /// The robots there are.
    pub robots: Arc<Robots>,
    /// The grounds there are.
    pub terrains: Arc<Terrains>,
    /// The versions of the map.
    pub store: Arc<TerrainStore>,
    /// Maps made of what its cameras see.
    pub reconstructions: Reconstructions,
    /// Rasters that can be laid over the ground.
    pub overlays: Overlays,
    /// The live rover.
    pub live: Live,
    /// Where its legs can stand.
    pub reach: LiveReach,
    /// Long work.
    pub jobs: Jobs,
    /// Plans of the live rover.
    pub plans: Plans,
    /// What the adviser answered about the live rover.
    pub postures: Postures,
    /// Replays of logs.
    pub replays: Replays,
    /// The channels that are logged, with their schemas.
    pub schemas: Vec<ChannelSchema>,
    /// Lets analyses in.
    pub gate: Gate,
    /// A place for each listener on the stream.
    pub listeners: Arc<Semaphore>,
    /// Becomes true when the server ends.
    pub closing: watch::Receiver<bool>,
}

impl App {
    /// What analyses are resolved against, the live rover as it is now included.
    pub fn context(&self) -> Context {
        Context {
            robots: self.robots.clone(),
            terrains: self.terrains.clone(),
            config: self.config.clone(),
            live: Some(self.live.scene(&self.store)),
        }
    }

    /// The folder of a terrain file, which must be a plain name.
    pub fn terrain_file(&self, name: &str) -> Result<std::path::PathBuf, ApiError> {
        if crate::terrains::is_file_name(name) {
            return Ok(self.config.server.terrain_dir.join(name));
        }
        let message = "a terrain file has a plain name of 1 to 64 of A-Z a-z 0-9 . _ -";
        Err(ApiError::new("file_name_invalid", message))
    }
}
