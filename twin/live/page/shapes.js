/* Shapes about a place on the ground, as rings of longitude and latitude. */

const PER_LATITUDE_M = 111320;

/** A place so many metres east and north of another. */
export function beside([longitude, latitude], east, north) {
  const perLongitude = PER_LATITUDE_M * Math.cos((latitude * Math.PI) / 180);
  return [longitude + east / perLongitude, latitude + north / PER_LATITUDE_M];
}

/** How many metres lie between two places near to each other. */
export function apart([longitude, latitude], [otherLongitude, otherLatitude]) {
  const perLongitude = PER_LATITUDE_M * Math.cos((latitude * Math.PI) / 180);
  return Math.hypot((otherLongitude - longitude) * perLongitude, (otherLatitude - latitude) * PER_LATITUDE_M);
}

/** An ellipse; its long axis points to `azimuth` degrees from north. */
export function ellipse(place, major, minor, azimuth, corners = 48) {
  const turn = (azimuth * Math.PI) / 180;
  return Array.from({ length: corners + 1 }, (_, at) => {
    const angle = (2 * Math.PI * (at % corners)) / corners;
    const [along, across] = [major * Math.cos(angle), minor * Math.sin(angle)];
    return beside(place, along * Math.sin(turn) + across * Math.cos(turn), along * Math.cos(turn) - across * Math.sin(turn));
  });
}

/** What a camera of a car at `place` that looks to `heading` sees of the ground within `reach` metres. */
export function wedge(place, heading, camera, reach) {
  const turn = (heading * Math.PI) / 180;
  const eye = beside(
    place,
    camera.forward_m * Math.sin(turn) - camera.left_m * Math.cos(turn),
    camera.forward_m * Math.cos(turn) + camera.left_m * Math.sin(turn),
  );
  const steps = 12;
  const edge = Array.from({ length: steps + 1 }, (_, at) => {
    const angle = ((heading + camera.azimuth_deg + camera.half_fov_deg * ((2 * at) / steps - 1)) * Math.PI) / 180;
    return beside(eye, reach * Math.sin(angle), reach * Math.cos(angle));
  });
  return [eye, ...edge, eye];
}

export const feature = (type, coordinates, properties = {}) => ({ type: "Feature", geometry: { type, coordinates }, properties });
export const collection = (features) => ({ type: "FeatureCollection", features });
