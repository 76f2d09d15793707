"use strict";
// The camera sees what is 4 wide and 3 high: in a narrower window all is drawn smaller, so that the sides stay in sight.

(() => {
  const set = viewer.set_property.bind(viewer);
  const resize = viewer.set_3d_pane_size.bind(viewer);
  let zoom = 1;
  function fit() {
    viewer.camera.zoom = zoom * Math.min(1, viewer.camera.aspect * 3 / 4);
    viewer.camera.updateProjectionMatrix();
    viewer.set_dirty();
  }
  viewer.set_property = (path, property, value) => {
    set(path, property, value);
    if (property !== "zoom") return;
    zoom = value;
    fit();
  };
  viewer.set_3d_pane_size = (width, height) => {
    resize(width, height);
    fit();
  };
})();
