"""What `printmend new` begins a package with: each module here is whole, and kept by the suite as it stands."""
