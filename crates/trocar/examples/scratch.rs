//! scratch
use std::path::Path;
use std::time::Instant;
use trocar::identify::*;
use trocar::recording::*;
fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let mut train = vec![];
    let mut val = vec![];
    let mut mass = 0.0;
    let mut boot = 0;
    let mut it = args.iter();
    let mut v = false;
    while let Some(a) = it.next() {
        match a.as_str() {
            "-v" => v = true,
            "-m" => mass = it.next().unwrap().parse().unwrap(),
            "-b" => boot = it.next().unwrap().parse().unwrap(),
            f => {
                let r = read(Path::new(f), &ReadOptions::default()).unwrap();
                let r = if mass > 0.0 { r.without_moving_mass(mass, 0.0).unwrap() } else { r };
                if v { val.push(r) } else { train.push(r) }
            }
        }
    }
    for r in &train {
        println!(
            "{} n={} dt={} res={:.2e} pn={:.2e} fn={:.2e} warn={:?}",
            r.name,
            r.len(),
            r.quality.median_interval,
            r.quality.position_resolution,
            r.quality.position_noise,
            r.quality.force_noise,
            r.quality.warnings.iter().map(|w| &w.message).collect::<Vec<_>>()
        );
    }
    let t = Instant::now();
    let o = IdentifyOptions { bootstrap: boot, inertia_removed: mass > 0.0, ..Default::default() };
    let id = match identify(&train, &o, &|s, f| eprintln!("  {s} {f} {:?}", t.elapsed())) {
        Ok(i) => i,
        Err(e) => {
            println!("{e}");
            return;
        }
    };
    println!("identify {:?}", t.elapsed());
    for p in &id.parameters {
        if !p.name.contains("theta") {
            println!(
                "{:32} {:12.6} [{:12.6},{:12.6}] {} {:?}",
                p.name, p.estimate.value, p.estimate.ci95[0], p.estimate.ci95[1], p.estimate.unit, p.estimate.note
            );
        }
    }
    println!("-- two-step");
    for p in &id.two_step_parameters {
        if !p.name.contains("theta") {
            println!(
                "{:32} {:12.6} [{:12.6},{:12.6}] {}",
                p.name, p.estimate.value, p.estimate.ci95[0], p.estimate.ci95[1], p.estimate.unit
            );
        }
    }
    for m in id.steady.means.iter().take(if std::env::var("M").is_ok() { 200 } else { 0 }) {
        println!(
            "{:?} {:.4} {:.4} se {:.4} n {}",
            m.direction, m.velocity_m_s, m.force_n, m.standard_error_n, m.samples
        );
    }
    println!(
        "sym p {:?} scatter {} means {}",
        id.steady.symmetry_p_value,
        id.steady.pass_scatter_n,
        id.steady.means.len()
    );
    println!("lof {:?}", id.steady.lack_of_fit);
    if let Ok(d) = &id.deformation {
        println!(
            "scatter {:?} {:?}",
            d.rising.scatter.iter().map(|v| v * v).sum::<f64>() / 100.0,
            d.falling.scatter.iter().map(|v| v * v).sum::<f64>() / 100.0
        );
        println!(
            "traverses {} spread {} damping {:?} rms {} {} poly7 {} {}",
            d.traverses.len(),
            d.deflection_error,
            d.damping,
            d.rising.rms,
            d.falling.rms,
            d.rising.single_polynomial_rms,
            d.falling.single_polynomial_rms
        );
    } else {
        println!("{:?}", id.deformation.as_ref().err());
    }
    println!("{:?}\nresidual {}", id.refinement, id.residual_rms);
    for w in &id.warnings {
        println!("! {} {} {}", w.doubtful, w.subject, w.message);
    }
    for el in [(id.element, id.model.offset, "final")] {
        let t = Instant::now();
        for r in &val {
            let r = &r.clone().without_moving_mass(id.model.hidden_mass, 0.0).unwrap();
            let v = trocar::validate::validate(&[el.0], std::slice::from_ref(r), el.1);
            println!("{} {:?} {:?}", el.2, t.elapsed(), v);
        }
    }
    if let Ok(e) = id.two_step.element() {
        for r in &val {
            let v = trocar::validate::validate(&[e], std::slice::from_ref(r), id.two_step.offset);
            println!("two-step {} {}", r.name, v.rms_n);
        }
    }
}
