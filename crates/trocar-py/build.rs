//! Builds the library that `Model.export_fmu` puts into an FMU, so that the package carries it
//! inside.

fn main() {
    trocar_fmu::library::embed("Model.export_fmu");
}
