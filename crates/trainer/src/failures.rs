//! How many steps of training may fail before it ends.

/// Counts dropped steps in a row.
#[derive(Default)]
pub(crate) struct Failures(usize);

impl Failures {
    /// So many in a row end training.
    pub const MOST: usize = 20;

    /// How many were dropped since the last that came through.
    pub fn count(&self) -> usize {
        self.0
    }

    /// A step came through.
    pub fn end(&mut self) {
        self.0 = 0;
    }

    /// One more was dropped; returns how many those were when there are too many.
    pub fn add(&mut self) -> Option<usize> {
        self.0 += 1;
        (self.0 >= Self::MOST).then_some(self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TrainerError;
    use crate::body::Body;
    use crate::checkpoint::{Checkpoint, Stage};
    use crate::fixture;
    use crate::focus::Focus;
    use crate::rig::Rig;
    use crate::run::Run;
    use crate::scene::Scene;
    use crate::shapes::{Shape, Shapes};
    use crate::stage1::{Pulled, Regression, pull};
    use crate::stage2::{Outcome, ThroughSimulator};
    use crate::train::{network_config, train};
    use actuation_net::{ActuationNet, AdamState};
    use std::path::Path;

    /// A body, its shapes and what they were pulled to.
    struct Case {
        scene: Scene,
        body: Body,
        shapes: Shapes,
        pulled: Vec<Pulled>,
        net: ActuationNet,
    }

    impl Case {
        fn new() -> Self {
            let scene = fixture::scene("");
            let body = fixture::body(&scene);
            let shapes = fixture::shapes(&scene, &body);
            let all: Vec<&Shape> = shapes.all.iter().collect();
            let pulled = pull(&body, &scene, &all, || Ok(())).unwrap();
            let net = ActuationNet::new(&network_config(&scene, &shapes), 1).unwrap();
            Self {
                scene,
                body,
                shapes,
                pulled,
                net,
            }
        }

        fn descriptors(&self) -> Vec<Vec<f32>> {
            let all = self.shapes.all.iter();
            all.map(|shape| self.shapes.descriptor(&shape.positions).unwrap())
                .collect()
        }
    }

    #[test]
    fn a_loss_that_is_no_number_drops_the_step_of_stage_1_and_changes_nothing() {
        let mut case = Case::new();
        let descriptors = case.descriptors();
        let focus = Focus::new(&case.pulled, 0.0, 0.0);
        let adam = AdamState::new(case.net.parameter_count());
        let step = |case: &Case, net: &mut ActuationNet, adam: &mut AdamState| {
            let regression = Regression {
                points: &case.body.samples,
                descriptors: &descriptors,
                targets: &case.pulled,
                basis: &[0, 1],
                focus: &focus,
                settings: &case.scene.stage1,
                seed: 1,
            };
            regression.step(net, adam, 0)
        };
        let (mut net, mut state) = (case.net.clone(), adam.clone());
        step(&case, &mut net, &mut state).unwrap();
        assert!(net != case.net && state != adam);

        for target in &mut case.pulled {
            target.actuation.fill(f32::NAN);
        }
        let (mut net, mut state) = (case.net.clone(), adam.clone());
        let reason = step(&case, &mut net, &mut state).unwrap_err();
        assert!(reason.contains("loss"), "{reason}");
        assert!(net == case.net && state == adam, "something changed");
    }

    #[test]
    fn a_loss_that_is_no_number_drops_the_step_of_stage_2_and_changes_nothing() {
        let case = Case::new();
        let descriptors = case.descriptors();
        let mut lost = case.shapes.all.clone();
        for shape in &mut lost {
            shape.positions[7].y = f64::NAN;
        }
        let warm: Vec<_> = case.pulled.iter().map(|p| p.nodes.clone()).collect();
        let adam = AdamState::new(case.net.parameter_count());
        let step = |shapes: &[Shape]| {
            let shapes: Vec<&Shape> = shapes.iter().collect();
            let (body, scene) = (&case.body, &case.scene);
            let mut simulator = ThroughSimulator::new(body, scene, &shapes, &descriptors).unwrap();
            let (mut net, mut state, mut starts) = (case.net.clone(), adam.clone(), warm.clone());
            let outcome = simulator.step(&mut net, &mut state, &mut starts, 0);
            let is_same = net == case.net && state == adam && starts == warm;
            (outcome.unwrap(), is_same)
        };
        assert!(matches!(
            step(&case.shapes.all),
            (Outcome::Stepped(_), false)
        ));
        match step(&lost) {
            (Outcome::Dropped(reason), is_same) => {
                assert!(reason.contains("loss is NaN"), "{reason}");
                assert!(is_same, "something changed");
            }
            (Outcome::Stepped(_), _) => panic!("a step by a loss that is no number"),
        }
    }

    /// A run of the fixture's scene with parts of it replaced.
    fn run(folder: &Path, changes: &[(&str, &str)]) -> Run {
        let mut text = fixture::SCENE.to_string();
        for (from, to) in changes {
            assert!(text.contains(from), "{from}");
            text = text.replacen(from, to, 1);
        }
        Run::create(folder, &text, &fixture::inputs(), &Rig::default(), None).unwrap()
    }

    fn checkpoint(run: &Run) -> Checkpoint {
        let scene = run.scene().unwrap();
        let body = fixture::body(&scene);
        let config = network_config(&scene, &fixture::shapes(&scene, &body));
        // Refuses every number that is none.
        let state = Checkpoint::read(run, &config).unwrap();
        let positions = state.warm.iter().flatten().flat_map(|x| x.iter());
        assert!(positions.into_iter().all(|x| x.is_finite()));
        state
    }

    /// Lines of the metrics that tell of a dropped step.
    fn told(run: &Run) -> usize {
        let text = std::fs::read_to_string(run.metrics_path()).unwrap();
        // What JSON makes of a number that is none.
        assert!(!text.contains("null"), "{text}");
        text.lines().filter(|l| l.contains("\"dropped\"")).count()
    }

    /// Training that diverges says so, keeps the last good state, and is resumed to the same end: the failed steps were saved as done, and
    /// every resumption dropped twenty more.
    #[track_caller]
    fn ends_with_the_last_good_checkpoint(stage: Stage, changes: &[(&str, &str)]) {
        let folder = tempfile::tempdir().unwrap();
        let run = run(folder.path(), changes);
        let number = if stage == Stage::One { 1 } else { 2 };
        let mut ends = Vec::new();
        for _ in 0..2 {
            let error = train(&run).err().expect("an end without an error");
            assert!(
                matches!(&error, TrainerError::Diverged { count, stage, .. }
                    if *count == Failures::MOST && *stage == number),
                "{error}"
            );
            let message = error.to_string();
            for part in [
                "checkpoint.safetensors",
                &format!("stage{number}.learning_rate"),
            ] {
                assert!(message.contains(part), "{message}");
            }
            let state = checkpoint(&run);
            assert_eq!(state.stage, stage);
            assert_eq!(told(&run), Failures::MOST + state.dropped as usize);
            assert!(!run.model_path().exists());
            ends.push((message, state.step, state.dropped, state.net, state.adam));
        }
        assert!(ends[0] == ends[1], "resuming came to another end");
    }

    #[test]
    fn a_learning_rate_of_a_thousand_in_stage_1_ends_with_the_last_good_checkpoint() {
        let steep = ("epochs = 2", "epochs = 100\nlearning_rate = 1e3");
        ends_with_the_last_good_checkpoint(Stage::One, &[steep]);
    }

    #[test]
    fn a_learning_rate_of_a_thousand_in_stage_2_ends_with_the_last_good_checkpoint() {
        let steep = ("epochs = 1", "epochs = 20\nlearning_rate = 1e3");
        ends_with_the_last_good_checkpoint(Stage::Two, &[steep]);
    }
}
