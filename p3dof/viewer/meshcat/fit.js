"use strict";
// The camera sees what is `width` times as wide as high: in a narrower window all is drawn smaller, so that the
// sides stay in sight.

(() => {
  const set = viewer.set_property.bind(viewer);
  const resize = viewer.set_3d_pane_size.bind(viewer);
  let zoom = 1, width = 4 / 3;
  function fit() {
    viewer.camera.zoom = zoom * Math.min(1, viewer.camera.aspect / width);
    viewer.camera.updateProjectionMatrix();
    viewer.set_dirty();
  }
  viewer.set_property = (path, property, value) => {
    if (property === "picture_width") width = value;
    else set(path, property, value);
    if (property === "zoom") zoom = value;
    if (property === "picture_width" || property === "zoom") fit();
  };
  viewer.set_3d_pane_size = (width, height) => {
    resize(width, height);
    fit();
  };
})();
