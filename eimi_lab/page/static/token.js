// The token: it comes in the fragment of the address, and stays in this tab's sessionStorage.
const given = /^#token=([\w-]+)(#.*)?$/.exec(location.hash);
if (given) {
  sessionStorage.setItem("token", given[1]);
  history.replaceState(null, "", location.pathname + (given[2] ?? ""));
}
export const token = sessionStorage.getItem("token") ?? "";
