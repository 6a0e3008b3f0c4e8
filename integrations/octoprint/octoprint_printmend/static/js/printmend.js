// SPDX-License-Identifier: AGPL-3.0-or-later
// Popups while a file is mended: begun (how far it is, a button to cancel), done with the promise, failed, held.
$(function () {
    function PrintmendViewModel() {
        var self = this;
        self.open = {};

        function millimetres(errors) {
            return errors ? errors.rms_mm.toFixed(3) + " mm" : "?";
        }

        function show(path, options) {
            if (self.open[path]) {
                self.open[path].remove();
            }
            options.text = _.escape(options.text);
            self.open[path] = new PNotify(options);
        }

        self.onDataUpdaterPluginMessage = function (plugin, data) {
            if (plugin !== "printmend") {
                return;
            }
            if (data.what === "start") {
                show(data.path, {
                    title: gettext("Mending …"), text: data.path, hide: false,
                    confirm: {
                        confirm: true,
                        buttons: [
                            {text: gettext("Cancel"), click: function () { OctoPrint.simpleApiCommand("printmend", "cancel"); }},
                            {text: "", addClass: "hidden"}
                        ]
                    }
                });
            } else if (data.what === "progress" && self.open[data.path]) {
                var percent = Number(data.percent);
                self.open[data.path].update({
                    title: gettext("Mending …") + " " + percent + " %",
                    text: _.escape(data.path) + "<div class='progress'><div class='bar' style='width: " + percent + "%'></div></div>"
                });
            } else if (data.what === "done") {
                show(data.path, {
                    title: gettext("Mended"), type: "success",
                    text: data.copy + ": " + millimetres(data.before) + " → " + millimetres(data.after)
                });
            } else if (data.what === "test print") {
                show(data.path, {
                    title: gettext("A test print"),
                    text: data.path + " " + gettext("shows the printer as it is, so it is not mended.")
                });
            } else if (data.what === "held") {
                show(data.path, {
                    title: gettext("Waiting for the mended copy"), hide: false,
                    text: data.path + " " + gettext("was not started; its mended copy follows.")
                });
            } else if (data.what === "foreign" || data.what === "forged") {
                show(data.path, {
                    title: data.held ? gettext("Not to be printed") : gettext("Printed as it is"), hide: false,
                    text: data.path + ": " + data.reason
                });
            } else if (data.what === "refused") {
                show(data.path, {
                    title: gettext("Not printed"), type: "error", hide: false, text: data.path + ": " + data.reason
                });
            } else if (data.what === "failed") {
                show(data.path, {
                    title: gettext("Not mended, not printed"), type: "error", hide: false,
                    text: data.path + ": " + data.reason
                });
            }
        };
    }

    OCTOPRINT_VIEWMODELS.push({construct: PrintmendViewModel});
});
