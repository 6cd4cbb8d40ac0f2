//! First paths and smoothing in synthetic spaces with certified edges.
//!
//! Baseline: the same planners with edges sampled at 0.01 rad, which may miss what is thinner. One
//! run takes twelve scenes, so that no single one decides.

use criterion::{Criterion, criterion_group, criterion_main};
use motion::Unwatched;
use motion::astar::AStar;
use motion::planner::{PathSearch, Query, SearchOutcome};
use motion::rrt_connect::RrtConnect;
use motion::sbl::Sbl;
use motion::smooth::{SmoothOptions, smooth};

use synthetic::{Synthetic, cluttered, window};

#[path = "../tests/it/synthetic.rs"]
#[allow(dead_code)]
mod synthetic;

fn scenes() -> Vec<(Synthetic, Query)> {
    (0..6).map(cluttered).chain((0..6).map(|seed| window(0.5, 0.1, seed))).collect()
}

fn benches(c: &mut Criterion) {
    let certified = scenes();
    let sampled: Vec<_> = scenes().into_iter().map(|(s, q)| (s.sampled(0.01), q)).collect();
    let planners: [(&str, Box<dyn PathSearch>); 3] = [
        ("SBL", Box::new(Sbl::default())),
        ("RRT-Connect", Box::new(RrtConnect::default())),
        ("A*", Box::new(AStar::default())),
    ];
    let mut group = c.benchmark_group("search");
    group.sample_size(10);
    for (rule, scenes) in [("certified", &certified), ("sampled (baseline)", &sampled)] {
        for (name, planner) in &planners {
            group.bench_function(format!("{name}, {rule}"), |b| {
                b.iter(|| {
                    for (space, query) in scenes {
                        planner.search(&mut space.clone(), query, &mut Unwatched);
                    }
                });
            });
        }
        let paths: Vec<_> = scenes
            .iter()
            .filter_map(|(space, query)| {
                let search =
                    RrtConnect::default().search(&mut space.clone(), query, &mut Unwatched);
                match search.outcome {
                    SearchOutcome::Found(path) => Some((space, path)),
                    _ => None,
                }
            })
            .collect();
        group.bench_function(format!("smoothing, {rule}"), |b| {
            b.iter(|| {
                for (space, path) in &paths {
                    let options = SmoothOptions::default();
                    let _ = smooth(&mut (*space).clone(), path, &options, &mut Unwatched);
                }
            });
        });
    }
    group.finish();
}

criterion_group!(search, benches);
criterion_main!(search);
