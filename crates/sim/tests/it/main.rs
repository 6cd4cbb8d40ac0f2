//! The simulated rover on planes, slopes, synthetic and real ground.
