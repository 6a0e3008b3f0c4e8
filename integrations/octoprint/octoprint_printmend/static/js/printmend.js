// SPDX-License-Identifier: AGPL-3.0-or-later
// Popups while a file is mended: begun (how far it is, a button to cancel), done with the promise, failed, held.
// A badge in the list of files: what a file is, and what was promised. The settings: upload a model, try it.
$(function () {
    function PrintmendViewModel(parameters) {
        var self = this;
        self.settingsViewModel = parameters[0];
        self.files = parameters[1];
        self.open = {};
        self.model = ko.observable();
        self.modelWords = ko.observable("");
        self.models = ko.observableArray([]);
        self.chosen = ko.observable();
        self.testing = ko.observable(false);
        self.tested = ko.observable("");
        self.mended = ko.observable("");
        self.studio = ko.observable("");
        self.code = ko.observable("");
        self.pairing = ko.observable(false);
        self.paired = ko.observable("");

        self.chosen.subscribe(function (path) {
            if (path) {
                self.settingsViewModel.settings.plugins.printmend.model(path);
            }
        });

        self.look = function () {
            return OctoPrint.get("api/plugin/printmend").done(function (told) {
                self.model(told.model);
                self.models(told.models);
                self.modelWords(told.printer ? "(" + told.printer + ", " + told.model + ")" : "");
            });
        };

        self.onUserLoggedIn = self.onSettingsShown = self.onEventSettingsUpdated = function () { self.look(); };

        self.uploadModel = function (_, event) {
            var file = event.target.files[0];
            if (!file) {
                return;
            }
            OctoPrint.ajax("POST", "plugin/printmend/model", {
                data: file, processData: false, contentType: "application/octet-stream", dataType: "json"
            }).done(function (told) {
                self.settingsViewModel.settings.plugins.printmend.model(told.path);
                self.tested(told.printer + ": " + gettext("this model is in use now."));
                self.look();
            }).fail(function (answer) {
                self.tested((answer.responseJSON && answer.responseJSON.error) || gettext("The file could not be uploaded."));
            });
            event.target.value = "";
        };

        self.test = function () {
            self.testing(true);
            self.tested(gettext("Mending a test square …"));
            self.settingsViewModel.saveData().done(function () { OctoPrint.simpleApiCommand("printmend", "test"); });
        };

        // The settings hold the program's path: what was typed there counts.
        self.pair = function () {
            self.pairing(true);
            self.paired("");
            self.settingsViewModel.saveData().then(function () {
                return OctoPrint.simpleApiCommand("printmend", "pair", {address: self.studio(), code: self.code()});
            }).done(function (told) {
                self.paired(told.error || gettext("Paired: its model is in use now."));
                if (!told.error) {
                    self.code("");
                    self.settingsViewModel.requestData();
                }
            }).fail(function () {
                self.paired(gettext("OctoPrint does not let you pair it."));
            }).always(function () { self.pairing(false); });
        };

        self.mendAll = function () {
            OctoPrint.simpleApiCommand("printmend", "mend_all").done(function (told) {
                self.mended(told.queued.length ? told.queued.join(", ") : gettext("All that is here is mended."));
            });
        };

        // What the list says of a file: its state now, and the promise.
        self.badge = function (data) {
            var told = data.printmend;
            if (!told || !told.state) {
                return {text: "", css: "", title: ""};
            }
            var state = told.state;
            if (state === "current" && told.model && self.model() && told.model !== self.model()) {
                state = "stale";
            }
            var names = {
                current: gettext("mended"), stale: gettext("mended with an earlier model"),
                foreign: gettext("another printer's"), forged: gettext("changed after mending"),
                unmended: told.copy ? gettext("original") : gettext("not mended"),
                failed: gettext("not mended"), "test print": gettext("test print")
            };
            var colours = {
                current: "label-success", stale: "label-warning", foreign: "label-important",
                forged: "label-important", failed: "label-important"
            };
            var promise = told.before && told.after ? " " + millimetres(told.before) + " → " + millimetres(told.after) : "";
            return {
                text: (names[state] || state) + promise, css: "label " + (colours[state] || ""),
                title: state === told.state ? told.reason || "" : gettext("This printer was learned again since.")
            };
        };

        var template = $("#files_template_machinecode");
        self.files.printmendBadge = self.badge;
        template.text(template.text().replace(
            '<div class="size">',
            '<div class="printmend"><span style="white-space: normal" data-bind="text: $root.printmendBadge($data).text, ' +
                'css: $root.printmendBadge($data).css, attr: {title: $root.printmendBadge($data).title}"></span></div><div class="size">'
        ));

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
            } else if (data.what === "tested") {
                self.testing(false);
                self.tested(data.reason ? data.reason : (data.printer ? data.printer + ": " : "") + gettext("a test square") + " " +
                    millimetres(data.before) + " → " + millimetres(data.after) + ", " + data.took_s.toFixed(1) + " s");
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

    OCTOPRINT_VIEWMODELS.push({
        construct: PrintmendViewModel, dependencies: ["settingsViewModel", "filesViewModel"],
        elements: ["#settings_plugin_printmend"]
    });
});
