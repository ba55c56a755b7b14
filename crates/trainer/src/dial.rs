//! The accuracy that a user asks for, as one length, and what it means for solver and adjoint.

use crate::error::{Result, TrainerError};
use crate::scene::Scene;
use crate::units::Length;
use std::path::Path;

impl Scene {
    /// Sets [`Scene::accuracy`].
    ///
    /// # Errors
    /// When its unit cannot be turned into the scene's.
    pub fn set_accuracy(&mut self, accuracy: &Length) -> Result<()> {
        match accuracy.in_unit(&self.unit) {
            Ok(_) => self.accuracy = Some(accuracy.clone()),
            Err(_) => {
                return Err(TrainerError::Option {
                    option: "--accuracy",
                    text: accuracy.to_string(),
                    mend: "give a bare number, in the scene's unit, which has no known size",
                });
            }
        }
        Ok(())
    }

    /// The accuracy asked by [`Scene::accuracy`], in the scene's unit.
    pub fn accuracy_asked(&self) -> Option<f64> {
        // Scenes whose unit does not fit are refused when they are read.
        self.accuracy.as_ref()?.in_unit(&self.unit).ok()
    }

    /// Accuracy of the equilibria in training, for a body of this diagonal, in the scene's unit.
    pub fn training_accuracy(&self, diagonal: f64) -> f64 {
        let asked = self.accuracy_asked();
        asked.unwrap_or(self.stage2.accuracy * diagonal)
    }

    /// Accuracy of the equilibria that are shown and measured.
    pub fn evaluation_accuracy(&self, diagonal: f64) -> f64 {
        let asked = self.accuracy_asked();
        asked.unwrap_or(self.evaluation.accuracy * diagonal)
    }

    /// Relative residual of the adjoint. An equilibrium that is off by a share of the body makes its gradient wrong by some of those shares,
    /// and an adjoint that is closer would not mend that.
    pub fn adjoint_tolerance(&self, diagonal: f64) -> f64 {
        const SHARES: f64 = 100.0;
        let asked = self.accuracy_asked();
        asked.map_or(self.stage2.adjoint_tolerance, |length| {
            (SHARES * length / diagonal).clamp(1e-9, 1e-2)
        })
    }
}

/// The text of a scene with another [`Scene::accuracy`].
pub fn with_accuracy(text: &str, accuracy: &Length) -> String {
    let own = serde_json::to_string(accuracy).expect("plain data serialises");
    let mut is_top = true;
    let kept = text.split_inclusive('\n').filter(|line| {
        let line = line.trim_start();
        is_top &= !line.starts_with('[');
        let key = line.split('=').next().unwrap_or_default().trim();
        !(is_top && key == "accuracy")
    });
    format!("accuracy = {own}\n{}", kept.collect::<String>())
}

/// The text of a scene with another `mesh.element_size`; without its comments where that does not stand on a line of its own.
pub fn with_element_size(text: &str, scene: &Scene) -> String {
    let mut in_mesh = false;
    let lines = text.split_inclusive('\n').map(|line| {
        let start = line.trim_start();
        if start.starts_with('[') {
            in_mesh = start.starts_with("[mesh]");
        }
        let key = start.split('=').next().unwrap_or_default().trim();
        match in_mesh && key == "element_size" {
            true => format!("element_size = {}\n", scene.mesh.element_size),
            false => line.to_string(),
        }
    });
    let edited: String = lines.collect();
    match Scene::parse(&edited, Path::new("")) {
        Ok(read) if read == *scene => edited,
        _ => toml::to_string(scene).expect("a scene is plain data"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    #[test]
    fn one_length_sets_all_tolerances() {
        let own = fixture::scene("");
        assert_eq!(own.training_accuracy(3.0), 3.0 * own.stage2.accuracy);
        assert_eq!(own.evaluation_accuracy(3.0), 3.0 * own.evaluation.accuracy);
        assert_eq!(own.adjoint_tolerance(3.0), own.stage2.adjoint_tolerance);

        let text = with_accuracy(fixture::SCENE, &"0.05 mm".parse().unwrap());
        let text = text.replace("[surface]", "unit = \"cm\"\n[surface]");
        let scene = Scene::parse(&text, Path::new("ball.toml")).unwrap();
        assert!((scene.training_accuracy(3.0) - 0.005).abs() < 1e-15);
        assert!((scene.evaluation_accuracy(3.0) - 0.005).abs() < 1e-15);
        assert_eq!(scene.adjoint_tolerance(3.0), 1e-2);
        assert!((scene.adjoint_tolerance(5000.0) - 1e-4).abs() < 1e-12);

        // The last word counts, and keys of tables stay.
        let text = with_accuracy(&text, &"1e-3".parse().unwrap());
        assert!(text.starts_with("accuracy = 0.001\n") && !text.contains("mm"));
        let stage2 = text + "accuracy = 0.5\n";
        let again = Scene::parse(&stage2, Path::new("ball.toml")).unwrap();
        assert_eq!(
            (again.training_accuracy(3.0), again.stage2.accuracy),
            (1e-3, 0.5)
        );
    }

    #[test]
    fn a_length_that_does_not_fit_the_unit_of_the_scene_is_refused() {
        let text = with_accuracy(fixture::SCENE, &"0.05 mm".parse().unwrap());
        let error = Scene::parse(&text, Path::new("ball.toml")).unwrap_err();
        let message = error.to_string();
        assert!(
            message.contains("accuracy") && message.contains("bare number"),
            "{message}"
        );
        let mut scene = fixture::scene("");
        assert!(scene.set_accuracy(&"1 mm".parse().unwrap()).is_err());
        scene.set_accuracy(&"0.01".parse().unwrap()).unwrap();
        assert_eq!(scene.training_accuracy(3.0), 0.01);
    }

    #[test]
    fn the_size_of_elements_is_replaced_where_it_stands() {
        let text = fixture::SCENE.replace(
            "element_size = 0.4",
            "element_size = 0.4 # coarse\nsamples = 1",
        );
        let mut scene = Scene::parse(&text, Path::new("ball.toml")).unwrap();
        scene.mesh.element_size = 0.123;
        let edited = with_element_size(&text, &scene);
        assert_eq!(edited, text.replace("0.4 # coarse", "0.123"));
        let inline = text.replace("[mesh]\nelement_size = 0.4 # coarse\nsamples = 1\n", "");
        let inline = inline.replace(
            "name = \"ball\"",
            "name = \"ball\"\nmesh = { element_size = 0.4, samples = 1 }",
        );
        let edited = with_element_size(&inline, &scene);
        assert_eq!(
            Scene::parse(&edited, Path::new("ball.toml")).unwrap(),
            scene
        );
    }
}
