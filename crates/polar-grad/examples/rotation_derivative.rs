//! How a muscle's rotation follows its deformation: the derivative of the polar rotation, checked
//! by central differences from a comfortable shape down to the edge of inversion, where it grows
//! like `1 / (s_y + s_z)`.

use nalgebra::{Matrix3, Vector3};
use polar_grad::{RotationGradient, polar_rotation};

fn main() {
    let turn = nalgebra::Rotation3::from_euler_angles(0.4, -0.2, 0.9).into_inner();
    let direction = Matrix3::new(0.3, -0.1, 0.2, 0.5, 0.1, -0.4, 0.0, 0.7, -0.2);
    println!(
        "{:>10} {:>12} {:>12} {:>12}",
        "s_z", "s_y + s_z", "|dR|", "difference"
    );
    for s_z in [0.8, 0.2, -0.3, -0.6, -0.69, -0.699] {
        let m = turn * Matrix3::from_diagonal(&Vector3::new(1.2, 0.7, s_z));
        let gradient = RotationGradient::at(&m);
        let d_r = gradient.apply(&direction);
        let h = 1e-4 * gradient.smallest_pair_sum;
        let slope = (polar_rotation(&(m + direction * h)) - polar_rotation(&(m - direction * h)))
            / (2.0 * h);
        let difference = (slope - d_r).norm() / d_r.norm();
        println!(
            "{s_z:>10.3} {:>12.3e} {:>12.3e} {difference:>12.1e}",
            gradient.smallest_pair_sum,
            d_r.norm()
        );
        assert!(difference < 1e-6);
    }
}
