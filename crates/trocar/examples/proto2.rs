use serde_json::Value;
use trocar_model::*;
fn main() {
    let v: Value = serde_json::from_str(&std::fs::read_to_string("/tmp/hm1/model.json").unwrap()).unwrap();
    let d = &v["elements"][0]["deformation"];
    let br = |n: &str| {
        let p = |i: usize| {
            let p = &d[n]["pieces"][i];
            let l: Vec<f64> = p["legendre_n"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
            Piece::new(p["from_m"].as_f64().unwrap(), p["to_m"].as_f64().unwrap(), &l).unwrap()
        };
        Branch::new(p(0), p(1)).unwrap()
    };
    let (r, f) = (br("rising"), br("falling"));
    let a = DeformationForce::new(r, f, None).unwrap();
    println!("{} {}", a.yield_stiffness(), a.yield_stiffness() / 1.01);
    let c = a.half_width();
    for e in [1.0, 1.0 - 1e-15, 1.0 - 1e-9, 1.0 - 1e-4, 1.0 - 1e-3, 1.0 - 2e-3, 0.99] {
        println!("{e} gap {} | {}", a.half_gap(-c * e), a.half_gap(c * e));
    }
    for k in 0..=40 {
        let z = c * (-1.0 + k as f64 / 20.0);
        println!("{:.3} mid {:.3} gap {:.3}", 1e3 * z, a.mid(z), a.half_gap(z));
    }
}
